"""What leaving out a radar's scans while its level is steady saves, and what it costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.estimate.level import LEVELS, Estimate
from models.estimate.radar import RadarEstimator
from models.estimate.radar_adaptive import AdaptiveRadar
from models.evaluate import radar
from models.evaluate.report import Table

_COURSES = {
    "clean": ((0.0, 0.0),),
    "30, 60 and 100 % throughout": ((30.0, 30.0), (60.0, 60.0), (100.0, 100.0)),
    "a step to 60 %": ((0.0, 60.0),),
    "a step from 60 %": ((60.0, 0.0),),
}
_SECOND = 14


def effort_table(estimator: RadarEstimator, drives: Sequence[radar.Drive]) -> Table:
    """Return run time, share of scans looked at and error after the filter, for either effort.

    Parameters
    ----------
    drives:
        Of four seconds at least; a step is in the middle.
    """
    efforts: dict[str, Callable[[], Callable[[RadarScan], Estimate | None]]] = {
        "every scan": estimator.follow,
        "adaptive": lambda: AdaptiveRadar(estimator).estimate,
    }
    rows: list[tuple[str | float, ...]] = []
    for name, course in _COURSES.items():
        for effort, make in efforts.items():
            tracks = [_track(make(), drive, *step) for drive in drives for step in course]
            errors, seconds, looked = (np.array(part) for part in zip(*tracks, strict=True))
            half = errors.shape[1] // 2
            rows.append(
                (
                    name,
                    effort,
                    1e6 * float(seconds.mean()),
                    100 * float(looked.mean()),
                    float(errors[:, 2 * _SECOND : half].mean()),
                    float(errors[:, half : half + _SECOND].mean()),
                )
            )
    columns = (
        *("level", "effort", "run time a scan, µs", "scans looked at, %"),
        *("error in the first half, points", "in the second after it"),
    )
    return Table(
        "Radar: adaptive effort on simulated drives, after the filter", columns, tuple(rows)
    )


def _track(
    look: Callable[[RadarScan], Estimate | None], drive: radar.Drive, before: float, after: float
) -> tuple[NDArray[np.float64], float, float]:
    """Return the error of the filtered level by scan, mean run time in s, share looked at."""
    levels = radar.radar_filter()
    errors, seconds, looked = [], 0.0, 0
    for number, scan in enumerate(drive.scans):
        truth = before if number < len(drive.scans) // 2 else after
        noisy = radar.degraded(scan, "snr", truth, 0)
        start = perf_counter()
        estimate = look(noisy)
        if estimate is None:
            filtered = levels.predict(scan.stamp_ns)
        else:
            filtered = levels.update(scan.stamp_ns, estimate.probabilities)
        seconds += perf_counter() - start
        looked += estimate is not None
        errors.append(abs(float(filtered @ LEVELS) - truth))
    return np.array(errors), seconds / len(drive.scans), looked / len(drive.scans)
