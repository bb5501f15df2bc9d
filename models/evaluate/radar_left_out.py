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
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.degrade.radar import echo_db, threshold_db
from models.estimate.level import LEVELS
from models.estimate.radar_view import view
from models.evaluate.answer_plots import expected_calibration_error, reliability
from models.evaluate.radar import Answers, degraded, joined

_DIGITS = 4
_LOSSES = (50.0, 100.0)


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
    """What one scan of a drive tells; from ``reached`` on an accuracy and a mean error in points.

    Attributes
    ----------
    name, speed:
        Of the drive; its median speed, m/s.
    clusters:
        Of its clean scans, mean and standard deviation.
    lost:
        Of these, how many ``snr`` takes on the mean at 50 and at 100 %.
    threshold_std_db:
        Standard deviation of the threshold of detection, RCS − 40 log10(range), from scan to scan.
    reached:
        By the network.
    trees:
        By boosted trees; see ``models.training.radar_told`` for these and the next two.
    neighbours:
        By the same if the clean scans before and after were known.
    counted:
        By the same if the clean scan's number of clusters and threshold were known.
    gone:
        By the best test with the clean scan in hand, from which echoes are gone.
    """

    name: str
    speed: float
    clusters: list[float]
    lost: list[float]
    threshold_std_db: float
    reached: list[float]
    trees: list[float]
    neighbours: list[float]
    counted: list[float]
    gone: list[float]

    @classmethod
    def of(cls, name: str, scans: Sequence[RadarScan], *answers: Answers) -> OneDrive:
        """Return it from the answers to ``snr``, in the order of the attributes."""
        count, threshold = np.array([count_and_threshold(scan) for scan in scans]).T
        lost = [
            count.mean() - np.mean([len(degraded(scan, "snr", level, 0)) for scan in scans])
            for level in _LOSSES
        ]
        return cls(
            name,
            round(median_speed(scans), 1),
            [round(float(value), 1) for value in (count.mean(), count.std())],
            [round(float(value), 1) for value in lost],
            round(float(threshold.std()), 1),
            *(_accuracy_and_error(each) for each in answers),
        )


def count_and_threshold(scan: RadarScan) -> NDArray[np.float64]:
    """Return the number of clusters of a scan, and its threshold of detection in dB, (2,)."""
    own = view(scan)
    return np.array([len(own), threshold_db(echo_db(own.range_m, own.rcs))])


def median_speed(scans: Sequence[RadarScan]) -> float:
    """Return the vehicle's median speed over successive scans, m/s."""
    motions = [view(scan).motion for scan in scans]
    return float(np.median([np.hypot(each.ahead, each.left) for each in motions]))


@dataclass(frozen=True, slots=True)
class Learned:
    """What one scan tells by what was learned from; each an accuracy and a mean error in points.

    Attributes
    ----------
    others:
        Number of other recorded drives learned from.
    other_half:
        Whether the other half of the very drive was, too.
    reached, spread:
        Mean and standard deviation over choices of the other drives; see
        ``models.training.radar_learned``.
    moving, standing:
        Mean of the drives that move, and of those that stand; 0 where there are none.
    """

    others: int
    other_half: bool
    reached: list[float]
    spread: list[float]
    moving: list[float]
    standing: list[float]

    @classmethod
    def of(
        cls, others: int, other_half: bool, choices: Sequence[Answers], moving: NDArray[np.bool_]
    ) -> Learned:
        """Return it from the answers to all drives, one of each choice, and which drives move."""
        every = _by_choice(choices, np.ones_like(moving))
        parts = [_by_choice(choices, own).mean(axis=0) for own in (moving, ~moving)]
        figures = (every.mean(axis=0), every.std(axis=0), *parts)
        return cls(others, other_half, *(each.round(_DIGITS).tolist() for each in figures))


def _by_choice(choices: Sequence[Answers], drives: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return accuracy and mean error of some drives, (choices, 2); zeros where there are none."""
    if not drives.any():
        return np.zeros((1, 2))
    return np.array([_accuracy_and_error(each.among(drives[each.drives])) for each in choices])


@dataclass(frozen=True, slots=True)
class LeftOut:
    """All of it.

    Attributes
    ----------
    scan, window:
        One recorded scan, and seven successive ones at 2 Hz.
    drives:
        What one scan of each drive tells, and of all of them.
    learned:
        What one scan tells by how many drives were learned from.
    step_errors:
        With and without the window's restart: mean error of the filtered level by scan, points, at
        as many scans before a step between 0 and 60 %, up or down, as after it.
    """

    scan: LeftOutAnswers
    window: LeftOutAnswers
    drives: list[OneDrive]
    learned: list[Learned]
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
            [Learned(**each) for each in content["learned"]],
            content["step_errors"],
        )
