"""The card of a trained radar network: what it is, what it saw, what it reaches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.estimate.level import LEVELS, RADAR_KINDS
from models.estimate.radar_window import WINDOW
from models.evaluate.radar import Answers, Drive, joined, radar_filter
from models.evaluate.radar_learned import learned_from
from models.evaluate.radar_left_out import LeftOut
from models.sensor import ARS408

STEP_LEVEL = 60.0
"""Level of the step whose response is measured, %."""

TEMPERATURES = ((1, 0.0), (7, 0.5), (2, ARS408.cycle_s), (WINDOW, ARS408.cycle_s))
"""Numbers of scans, and seconds between them, of the windows whose temperature the card tells."""

_SETTLED = 28
"""Scans after the step, and before it, from which on the level is taken as settled: 2 s."""

_HEAD = """\
# Radar noise level

Tells from one cluster scan of an ARS 408, or from a scan and up to thirteen before it, how far its
signal-to-noise ratio has fallen: a distribution over eleven levels (0, 10, …, 100 %; 10 dB at
100 %) and the kind (clean, snr, ghosts, missed, jitter, noise_jam, interference, blockage).

- Input `window`: what `models.estimate.radar_window` reads from scans of 1 to 250 clusters: number,
  echo power and Doppler of each, and how near the echoes of one come back in the next; neither
  order, IDs nor quality fields. Outputs `level` and `kind`: logits, the level's divided by a
  temperature that depends on the window:
  {temperatures}.
  Inside, one perceptron is for a scan alone and one for a window.
- {parameters:,} parameters; {samples:,} training samples; seed {seed}.
- Reproduce: `murk train radar --data DATA --seed {seed}`.

## Trained on

{scans} recorded scans of {drives} drives, scans joined of two recorded ones, and simulated drives
at 14 Hz, each degraded by `models.degrade` at all eleven levels of `snr`, once by each
other kind, and with steps of `snr`.

**The recorded clusters come from nuScenes (CC BY-NC-SA 4.0). Whether weights trained on them
inherit those terms is not settled: for commercial use, train on data of your own.**

## Measured

Levels uniform over the eleven. Mean error: distance of the mean of the distribution from the true
level, percentage points. The figures on recorded drives are those of {drives} networks, each
trained the same way, temperature included, without the drive that it is measured on; the file holds
one that was trained on all. The same drives were looked at while the inputs were chosen, the
windows to train on, and how much the level of each kind weighs, among eight settings that gave 51.7
to 56.1 % and 6.2 to 7.6 points on seven scans, and 33.8 to 34.1 % and 13.7 to 13.9 points on one:
so these figures flatter a little. The simulated drives that it is measured on are in no training.
Filter: drift {drift} /s, jump {jump} /s, {shared:.0%} of the errors of successive answers shared.

The last two columns are bounds (accuracy / mean error): what the best test would say that had the
clean scan in hand and the law of the degradation, if it saw which echoes are gone, and if it also
saw how far each has moved. A scan alone shows no moves, and its clean scan can only be guessed.

| `snr` | count | accuracy | mean error | gone, clean scan known | gone and moved |
|---|---|---|---|---|---|
"""

_LIMITS = """
## Limits

- What bounds a single scan is the scene: which echoes a scan would have had without the loss
  can only be guessed, and moved echoes are not seen without another scan to compare. A vehicle at
  rest hides ghosts, which then have the right velocity.
- After a step of the level a window mixes both levels until its newest scans contradict what was
  answered before them and it starts anew: at 14 Hz two or three scans later, mostly; at 2 Hz every
  other time not before the old scans have left it.
- At 2 Hz few echoes come back while the vehicle moves, for they fluctuate: in a window it is the
  standing vehicle that is easy.
- Ghosts alone look the same at every level but 0. The level of missed clusters alone reads low,
  that of a jammer, of interference and of a blocked cover rises with the true one but not in
  proportion. At 14 Hz, where these kinds are told apart, their levels are answered with a wide
  distribution; at 2 Hz it is often too narrow.
- Images (`multipath`), deception and a bent bracket (`misalignment`) are not told from clean scans
  or from ghosts.
- Object mode is refused: the sensor's tracker hides the noise.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """What the trained networks reach.

    Attributes
    ----------
    kinds, windows:
        Single recorded scans, and seven successive ones without the filter, by kind of degradation.
    left_out:
        The same in short, with their bounds and the response to a step.
    together:
        Seven successive recorded scans with the filter.
    simulated:
        Single simulated scans.
    second, filtered_second:
        Fourteen simulated scans, without and with the filter.
    bounds:
        What the best tests with the clean scan in hand say, without and with moves, to recorded
        scans, seven of them, simulated scans, fourteen of them.
    step:
        Filtered level, %, of simulated drives with a step of ``snr`` from 0 to ``STEP_LEVEL`` in
        their middle, (drives, scans).
    """

    kinds: dict[str, Answers]
    windows: dict[str, Answers]
    left_out: LeftOut
    together: Answers
    simulated: Answers
    second: Answers
    filtered_second: Answers
    bounds: tuple[tuple[Answers, Answers], ...]
    step: NDArray[np.float64]

    @property
    def window(self) -> Answers:
        """Seven successive recorded scans degraded by ``snr``, without the filter."""
        return self.windows["snr"]

    def figures(self) -> dict[str, object]:
        """Return accuracy and mean error of each measurement."""
        before, after = self.step_errors()
        return {
            "recorded_scan": self.kinds["snr"].figures(),
            "recorded_seven_scans": self.window.figures(),
            "recorded_seven_scans_filtered": self.together.figures(),
            "simulated_scan": self.simulated.figures(),
            "simulated_second": self.second.figures(),
            "simulated_second_filtered": self.filtered_second.figures(),
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
    temperatures: Sequence[float],
    seed: int,
) -> None:
    """Write the card of a network from what was measured.

    Parameters
    ----------
    temperatures:
        Of windows as in ``TEMPERATURES``.
    """
    levels = radar_filter()
    text = _HEAD.format(
        temperatures=", ".join(
            f"{value:.2f} for {_window(*each)}"
            for value, each in zip(temperatures, TEMPERATURES, strict=True)
        ),
        parameters=parameters,
        samples=samples,
        seed=seed,
        scans=sum(len(drive.scans) for drive in drives),
        drives=len(drives),
        drift=levels.drift_per_s,
        jump=levels.jump_per_s,
        shared=levels.shared,
    )
    single = results.kinds["snr"]
    text += _row("one recorded scan", single, *results.bounds[0])
    text += _rows_by_drive(single, drives)
    text += _row("seven recorded scans, 2 Hz", results.window, *results.bounds[1])
    text += _rows_by_drive(results.window, drives)
    text += _row("– with the filter", results.together)
    text += _row("one simulated scan", results.simulated, *results.bounds[2])
    text += _row("fourteen simulated scans, 14 Hz", results.second, *results.bounds[3])
    text += _row("– with the filter", results.filtered_second)
    text += _known(results.left_out)
    before, after = results.step_errors()
    text += (
        f"\nA step of `snr` from 0 to {STEP_LEVEL:.0f} % on simulated drives: mean error of the "
        f"filtered level {before:.1f} points before it, {after:.1f} from two seconds after it.\n"
    )
    text += "\nMean level by true level, %:\n\n" + _means(results)
    for name, answers in (("One", single), ("Seven", results.window)):
        text += f"\n{name} recorded, true level (rows) and most probable level (columns), %:\n\n"
        text += _table(answers.confusion(), [f"{level:.0f}" for level in LEVELS])
    for name, kinds in (("one recorded scan", results.kinds), ("seven", results.windows)):
        text += f"\nKind of {name}, true (rows) and most probable (columns), %:\n\n"
        text += _table(joined(list(kinds.values())).kind_confusion(), list(RADAR_KINDS))
    path.write_text(text + _LIMITS, encoding="utf-8")


def _known(left_out: LeftOut) -> str:
    """Return what one recorded scan would tell if more were known."""
    every = left_out.drives[-1]
    rows = {
        "boosted trees": every.trees,
        "– told the clean scans half a second before and after": every.neighbours,
        "– told how many clusters the clean scan had, and its threshold": every.counted,
        **{
            f"a perceptron taught by simulated scans and {learned_from(each)}": each.reached
            for each in left_out.learned
        },
    }
    text = "\n| one recorded scan, if more were known | accuracy | mean error |\n|---|---|---|\n"
    return text + "".join(f"| {name} | {r:.1%} | {e:.1f} |\n" for name, (r, e) in rows.items())


def _window(scans: int, spacing_s: float) -> str:
    return f"{scans} scans at {1 / spacing_s:.0f} Hz" if scans > 1 else "a scan alone"


def _row(name: str, answers: Answers, *bounds: Answers) -> str:
    figures = answers.figures()
    beside = [
        f"{each.figures()['accuracy']:.1%} / {each.figures()['mean_error']:.1f}" for each in bounds
    ]
    return (
        f"| {name} | {figures['count']:,} | {figures['accuracy']:.1%} | "
        f"{figures['mean_error']:.1f} | {' | '.join(beside or ['', ''])} |\n"
    )


def _rows_by_drive(answers: Answers, drives: Sequence[Drive]) -> str:
    return "".join(
        _row(f"– {drive.name} left out", answers.among(answers.drives == index))
        for index, drive in enumerate(drives)
    )


def _means(results: Results) -> str:
    rows = {"seven recorded scans": results.window, "one simulated second": results.second}
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
