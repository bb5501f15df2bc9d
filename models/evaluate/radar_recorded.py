"""Shows what the radar's network reaches on recorded drives that its training left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from models.estimate.level import LEVELS, RADAR_KINDS
from models.evaluate.answer_plots import bins_picture
from models.evaluate.radar_learned import learned_results
from models.evaluate.radar_left_out import LeftOut, LeftOutAnswers, OneDrive
from models.evaluate.report import Goal, Result, Table

_RIGHT, _ERROR = 40.0, 10.0
"""Goals of one scan: right, %, and mean error, points."""
_BOUNDS = ("gone, clean known", "gone and moved")


def recorded_results(left_out: LeftOut) -> Iterator[Result]:
    """Yield goals, bounds, confusions, reliability and steps of recorded drives left out."""
    scan, window = left_out.scan, left_out.window
    yield Goal("radar, one recorded scan, right, %", 100 * scan.accuracy, _RIGHT)
    yield Goal("radar, one recorded scan, mean error, points", scan.mean_error, _ERROR, False)
    yield Goal("radar, seven recorded scans, right, %", 100 * window.accuracy, 55.0)
    yield Goal("radar, seven recorded scans, mean error, points", window.mean_error, 7.0, False)
    yield Table(
        "Radar: recorded drives left out of the training, and the bound",
        ("right / mean error, points", "answers", "reached", *_BOUNDS),
        tuple(
            (name, each.count, *map(_pair, _pairs(each)))
            for name, each in (("one recorded scan", scan), ("seven recorded scans", window))
        ),
    )
    yield from _drives(left_out.drives)
    yield from learned_results(left_out.learned, _RIGHT, _ERROR)
    for name, each in (("one recorded scan", scan), ("seven recorded scans", window)):
        counts, confidence, right = map(np.array, each.reliability)
        error = f"expected calibration error {each.calibration_error:.1%}"
        yield bins_picture(
            f"Radar: reliability, {name} ({error})", counts.astype(int), confidence, right
        )
        yield confusion_table(f"Radar: {name}, confusion, %", each.confusion)
        yield kinds_table(f"Radar: {name}, kinds, %", RADAR_KINDS, each.kind_confusion)
        yield errors_table(f"Radar: error by kind, {name}", each.kinds)
    yield levels_table(
        "Radar: seven recorded scans, estimated level by true level, %", window.levels
    )
    yield _steps(left_out.step_errors)


def _drives(drives: Sequence[OneDrive]) -> Iterator[Table]:
    """Yield what one scan of each drive tells, beside what it could, and why it does not."""
    rows: list[tuple[str | float, ...]] = [
        (
            each.name,
            each.speed,
            *map(_pair, (each.reached, each.trees, each.neighbours, each.counted, each.gone)),
        )
        for each in drives
    ]
    columns = (
        *("drive left out", "median speed, m/s", "reached, right / mean error, points"),
        *("boosted trees", "told the clean scans before and after"),
        *("told this clean scan's count and threshold", "bound, this clean scan known"),
    )
    yield Table("Radar: one recorded scan by drive, and what is missing", columns, tuple(rows))
    yield Table(
        "Radar: how clean scans of a drive differ, and what a loss takes of them",
        (
            *("drive", "median speed, m/s", "clusters of a clean scan", "± from scan to scan"),
            *("lost at 50 %", "lost at 100 %", "threshold ± from scan to scan, dB"),
        ),
        tuple(
            (each.name, each.speed, *each.clusters, *each.lost, each.threshold_std_db)
            for each in drives
        ),
    )


def _pair(figures: Sequence[float]) -> str:
    right, error = figures
    return f"{100 * right:.1f} % / {error:.1f}"


def _pairs(answers: LeftOutAnswers) -> list[list[float]]:
    return [[answers.accuracy, answers.mean_error], *answers.bounds]


def confusion_table(title: str, counts: Sequence[Sequence[int]]) -> Table:
    """Return shares of the levels that each true level was taken for, %."""
    names = [f"{level:.0f}" for level in LEVELS]
    return Table(title, ("true \\ estimated, %", *names), _shares(names, counts))


def kinds_table(title: str, true: Sequence[str], counts: Sequence[Sequence[int]]) -> Table:
    """Return shares of the kinds that each true kind was taken for, %."""
    return Table(title, ("true \\ most probable", *RADAR_KINDS), _shares(true, counts))


def levels_table(title: str, levels: dict[str, list[float]]) -> Table:
    """Return the mean estimated level at each true one, and how far they are apart on average."""
    rows: list[tuple[str | float, ...]] = [
        (kind, *(f"{level:.0f}" for level in row), float(np.abs(np.array(row) - LEVELS).mean()))
        for kind, row in levels.items()
    ]
    return Table(title, ("kind", *(f"{level:.0f}" for level in LEVELS), "apart"), tuple(rows))


def errors_table(title: str, kinds: Mapping[str, Mapping[str, float]]) -> Table:
    """Return how far off every kind is, and whether the answers know it, from its figures."""
    rows = [
        (
            kind,
            int(each["count"]),
            100 * each["accuracy"],
            each["mean_error"],
            each["std"],
            100 * each["within"],
        )
        for kind, each in kinds.items()
    ]
    columns = (
        *("kind", "answers", "level right, %", "mean error, points", "mean std, points"),
        "truth within two std, %",
    )
    return Table(title, columns, tuple(rows))


def _shares(names: Sequence[str], counts: Sequence[Sequence[int]]) -> tuple[tuple[str, ...], ...]:
    table = np.array(counts)
    shares = 100 * table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    return tuple(
        (name, *(f"{share:.0f}" for share in row)) for name, row in zip(names, shares, strict=True)
    )


def _steps(errors: dict[str, list[float]]) -> Table:
    """Return the error by scan around a step on recorded drives, with and without a restart."""
    half = len(next(iter(errors.values()))) // 2
    after = [f"scan {number}" for number in range(1, half + 1)]
    rows: list[tuple[str | float, ...]] = [
        (name, float(np.mean(row[:half])), *(f"{error:.0f}" for error in row[half:]))
        for name, row in errors.items()
    ]
    title = "Radar: recorded drives at 2 Hz, error after a step of 60 points, by scan"
    return Table(title, ("window", "before", *after), tuple(rows))
