"""On which simulated drives, and how fast, the radar's network and its opponents are measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from models.evaluate.radar import Drive, Estimator, simulated_drive
from models.evaluate.timing import median_us

SIMULATED = range(2**31 + 100, 2**31 + 104)
"""Seeds of simulated drives; training draws only seeds below 2**31."""
SECOND = 14
"""Scans in a second."""


def trial_seeds(quick: bool) -> Sequence[int]:
    """Return the seeds of the simulated drives: one where it must be quick."""
    return SIMULATED[:1] if quick else SIMULATED


def trial_drives(quick: bool) -> list[Drive]:
    """Return simulated drives of ten seconds, or a single one of two."""
    scans = (2 if quick else 10) * SECOND
    return [simulated_drive(seed, 0, scans) for seed in trial_seeds(quick)]


def run_time_us(follow: Callable[[], Estimator], drive: Drive, count: int, rounds: int) -> float:
    """Return the median time of one more scan for a window of ``count`` scans, µs.

    Parameters
    ----------
    follow:
        Makes an estimator for one sequence of scans; see ``RadarEstimator.follow``.
    drive:
        Of more scans than ``count``.
    """
    if count == 1:
        return median_us(lambda: follow()(drive.scans[0]), rounds)
    estimate = follow()
    for scan in drive.scans[:count]:
        estimate(scan)
    rest = iter(drive.scans[count:] * (1 + rounds // len(drive.scans[count:])))
    return median_us(lambda: estimate(next(rest)), rounds - 1)
