"""What the radar's network reaches on recorded drives that its training left out.

``murk train radar`` measures it with one network a drive, trained without it, and writes it beside
the shipped network; ``murk bench estimate`` shows it. It is what the file holds, not measured anew:
to do so is to train all networks again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from drivers.scan import RadarScan
from models.estimate.level import LEVELS
from models.estimate.radar_view import view
from models.evaluate.answer_plots import expected_calibration_error, reliability
from models.evaluate.radar import Answers, joined

_DIGITS = 4


@dataclass(frozen=True, slots=True)
class LeftOutAnswers:
    """Answers to recorded scans, or to seven successive ones, of drives left out.

    Attributes
    ----------
    count, accuracy, mean_error:
        Of ``snr`` at all eleven levels: answers, share of right ones, mean error in points.
    calibration_error:
        Expected calibration error of the same, 0 to 1.
    reliability:
        Answers, mean confidence and share of right ones of every bin of confidence.
    bounds:
        Accuracy and mean error of the best test with the clean scans in hand: from which echoes
        are gone, and from how far each has moved as well.
    confusion:
        How often each true level of ``snr`` (rows) was taken for each level, 11 × 11.
    kind_confusion:
        How often each true kind (rows) was taken for each kind, in the order of ``RADAR_KINDS``.
    levels:
        By kind, the mean estimated level at each true one, %, 11 each.
    kinds:
        By kind, its ``Answers.figures``.
    """

    count: int
    accuracy: float
    mean_error: float
    calibration_error: float
    reliability: list[list[float]]
    bounds: list[list[float]]
    confusion: list[list[int]]
    kind_confusion: list[list[int]]
    levels: dict[str, list[float]]
    kinds: dict[str, dict[str, float]]

    @classmethod
    def of(cls, kinds: Mapping[str, Answers], bounds: Sequence[Answers]) -> LeftOutAnswers:
        """Return it from the answers to every kind."""
        snr = kinds["snr"]
        figures = snr.figures()
        return cls(
            count=int(figures["count"]),
            accuracy=round(figures["accuracy"], _DIGITS),
            mean_error=round(figures["mean_error"], _DIGITS),
            calibration_error=round(
                expected_calibration_error(snr.probabilities, snr.levels), _DIGITS
            ),
            reliability=[
                [round(float(value), _DIGITS) for value in values]
                for values in reliability(snr.probabilities, snr.levels)
            ],
            bounds=[_accuracy_and_error(each) for each in bounds],
            confusion=snr.confusion().tolist(),
            kind_confusion=joined(list(kinds.values())).kind_confusion().tolist(),
            levels={kind: mean_levels(answers) for kind, answers in kinds.items()},
            kinds={
                kind: {name: round(value, _DIGITS) for name, value in answers.figures().items()}
                for kind, answers in kinds.items()
            },
        )


def _accuracy_and_error(answers: Answers) -> list[float]:
    figures = answers.figures()
    return [round(figures[name], _DIGITS) for name in ("accuracy", "mean_error")]


def mean_levels(answers: Answers) -> list[float]:
    """Return the mean estimated level at each true one, %, (11,)."""
    estimated = answers.probabilities @ LEVELS
    return [round(float(estimated[answers.levels == level].mean()), 1) for level in LEVELS]


@dataclass(frozen=True, slots=True)
class OneDrive:
    """What one scan of a drive tells; each an accuracy and a mean error in points.

    Attributes
    ----------
    name, speed:
        Of the drive; its median speed, m/s.
    reached:
        By the network.
    neighbours:
        If the clean scans before and after were known; see ``models.training.radar_told``.
    gone:
        By the best test with the clean scan in hand, from which echoes are gone.
    """

    name: str
    speed: float
    reached: list[float]
    neighbours: list[float]
    gone: list[float]

    @classmethod
    def of(cls, name: str, scans: Sequence[RadarScan], *answers: Answers) -> OneDrive:
        """Return it from the answers to ``snr``: reached, neighbours known, clean scan known."""
        motions = [view(scan).motion for scan in scans]
        speed = float(np.median([np.hypot(each.ahead, each.left) for each in motions]))
        return cls(name, round(speed, 1), *(_accuracy_and_error(each) for each in answers))


@dataclass(frozen=True, slots=True)
class LeftOut:
    """All of it.

    Attributes
    ----------
    scan, window:
        One recorded scan, and seven successive ones at 2 Hz.
    drives:
        What one scan of each drive tells, and of all of them.
    step_errors:
        With and without the window's restart: mean error of the filtered level by scan, points, at
        as many scans before a step between 0 and 60 %, up or down, as after it.
    """

    scan: LeftOutAnswers
    window: LeftOutAnswers
    drives: list[OneDrive]
    step_errors: dict[str, list[float]]

    def write(self, path: Path) -> None:
        """Write it as JSON."""
        path.write_text(json.dumps(asdict(self)) + "\n", encoding="utf-8")

    @classmethod
    def read(cls, path: Path) -> LeftOut:
        """Return what ``write`` wrote."""
        content = json.loads(path.read_text(encoding="utf-8"))
        return cls(
            LeftOutAnswers(**content["scan"]),
            LeftOutAnswers(**content["window"]),
            [OneDrive(**each) for each in content["drives"]],
            content["step_errors"],
        )
