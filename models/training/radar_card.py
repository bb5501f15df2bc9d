"""The card of a trained radar network: what it is, what it saw, what it reaches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.estimate.level import LEVELS, RADAR_KINDS
from models.evaluate.radar import Answers, Drive, joined, radar_filter

STEP_LEVEL = 60.0
"""Level of the step whose response is measured, %."""

_SETTLED = 28
"""Scans after the step, and before it, from which on the level is taken as settled: 2 s."""

_HEAD = """\
# Radar noise level

Tells from one cluster scan of an ARS 408 how far its signal-to-noise ratio has fallen: a
distribution over eleven levels (0, 10, …, 100 %; 10 dB at 100 %) and the kind (clean, snr, ghosts,
missed, jitter).

- Input `features`: what `models.estimate.radar_features` reads from a scan of 1 to 250 clusters;
  neither order, IDs nor quality fields. Outputs `level` and `kind`: logits, the level's tempered
  by {temperature:.2f}.
- {parameters:,} parameters; {samples:,} training samples; seed {seed}.
- Reproduce: `murk train radar --data DATA --seed {seed}`.

## Trained on

{scans} recorded scans of {drives} drives, scans joined of two recorded ones, and scans of murk's
simulated world, each degraded by `models.degrade.radar` at all eleven levels of `snr` and once by
ghosts, missed and jitter alone.

**The recorded clusters come from nuScenes (CC BY-NC-SA 4.0). Whether weights trained on them
inherit those terms is not settled: for commercial use, train on data of your own.**

## Measured

Levels uniform over the eleven. Mean error: distance of the mean of the distribution from the true
level, percentage points. The figures on recorded drives are those of {drives} networks, each
trained the same way without the drive that it is measured on (the temperature alone was fitted to
all of these answers); the file holds one that was trained on all. The simulated drives that it is
measured on are in no training. Filter: drift {drift} /s, jump {jump} /s, correlation
{correlation} s.

| `snr` | count | accuracy | mean error |
|---|---|---|---|
"""

_LIMITS = """
## Limits

- What bounds a single scan is the scene: which echoes a scan would have had without the loss
  can only be guessed. Jitter of less than the bus's own steps leaves no trace, and a vehicle at
  rest hides ghosts, which then have the right velocity.
- Ghosts alone look the same at every level but 0: their level is answered with a wide
  distribution.
- Object mode is refused: the sensor's tracker hides the noise.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """What the trained networks reach.

    Attributes
    ----------
    kinds:
        Single recorded scans by kind of degradation.
    together:
        Seven successive recorded scans through the filter.
    simulated, second:
        Single simulated scans, and fourteen of them through the filter.
    step:
        Filtered level, %, of simulated drives with a step of ``snr`` from 0 to ``STEP_LEVEL`` in
        their middle, (drives, scans).
    """

    kinds: dict[str, Answers]
    together: Answers
    simulated: Answers
    second: Answers
    step: NDArray[np.float64]

    def figures(self) -> dict[str, object]:
        """Return accuracy and mean error of each measurement."""
        before, after = self.step_errors()
        return {
            "recorded_scan": self.kinds["snr"].figures(),
            "recorded_seven_scans": self.together.figures(),
            "simulated_scan": self.simulated.figures(),
            "simulated_second": self.second.figures(),
            "step_error_before": before,
            "step_error_after": after,
        }

    def step_errors(self) -> tuple[float, float]:
        """Return the mean error of the settled filtered level before and after the step."""
        half = self.step.shape[1] // 2
        before = self.step[:, _SETTLED:half]
        after = self.step[:, half + _SETTLED :] - STEP_LEVEL
        return float(np.abs(before).mean()), float(np.abs(after).mean())


def write_card(
    path: Path,
    *,
    drives: Sequence[Drive],
    results: Results,
    samples: int,
    parameters: int,
    temperature: float,
    seed: int,
) -> None:
    """Write the card of a network from what was measured."""
    levels = radar_filter()
    text = _HEAD.format(
        temperature=temperature,
        parameters=parameters,
        samples=samples,
        seed=seed,
        scans=sum(len(drive.scans) for drive in drives),
        drives=len(drives),
        drift=levels.drift_per_s,
        jump=levels.jump_per_s,
        correlation=levels.correlation_s,
    )
    single = results.kinds["snr"]
    text += _row("one recorded scan", single)
    text += "".join(
        _row(f"– {drive.name} left out", single.among(single.drives == index))
        for index, drive in enumerate(drives)
    )
    text += _row("seven recorded scans, 2 Hz", results.together)
    text += _row("one simulated scan", results.simulated)
    text += _row("fourteen simulated scans, 14 Hz", results.second)
    before, after = results.step_errors()
    text += (
        f"\nA step of `snr` from 0 to {STEP_LEVEL:.0f} % on simulated drives: mean error of the "
        f"filtered level {before:.1f} points before it, {after:.1f} from two seconds after it.\n"
    )
    text += "\nMean filtered level by true level, %:\n\n" + _means(results)
    text += "\nOne recorded scan, true level (rows) and most probable level (columns), %:\n\n"
    text += _table(single.confusion(), [f"{level:.0f}" for level in LEVELS])
    text += "\nKind, true (rows) and most probable (columns), levels above 0 alike, %:\n\n"
    text += _table(joined(list(results.kinds.values())).kind_confusion(), list(RADAR_KINDS))
    path.write_text(text + _LIMITS, encoding="utf-8")


def _row(name: str, answers: Answers) -> str:
    figures = answers.figures()
    return (
        f"| {name} | {figures['count']:,} | {figures['accuracy']:.1%} | "
        f"{figures['mean_error']:.1f} |\n"
    )


def _means(results: Results) -> str:
    rows = {"seven recorded scans": results.together, "one simulated second": results.second}
    text = "| | " + " | ".join(f"{level:.0f}" for level in LEVELS) + " |\n"
    text += "|---" * (len(LEVELS) + 1) + "|\n"
    for name, answers in rows.items():
        means = [
            float((answers.probabilities[answers.levels == level] @ LEVELS).mean())
            for level in LEVELS
        ]
        text += f"| {name} | " + " | ".join(f"{mean:.0f}" for mean in means) + " |\n"
    return text


def _table(counts: NDArray[np.intp], names: list[str]) -> str:
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    text = "| | " + " | ".join(names) + " |\n" + "|---" * (len(names) + 1) + "|\n"
    for name, row in zip(names, shares, strict=True):
        text += f"| {name} | " + " | ".join(f"{100 * share:.0f}" for share in row) + " |\n"
    return text
