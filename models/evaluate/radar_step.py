"""How soon the radar's level follows a step, and how steady it is at rest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.estimate.radar import RadarEstimator
from models.estimate.radar_window import RECENT, WINDOW
from models.evaluate import radar
from models.evaluate.report import Picture, Result, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEPS = ((0.0, 60.0), (60.0, 0.0))
NEWEST = (RECENT, 3, 4, 6, WINDOW)
_SECOND = 14
_ALTERNATING_SCANS = 5


def step_results(estimator: RadarEstimator, drives: Sequence[radar.Drive]) -> Iterator[Result]:
    """Yield the error at rest and after a step by how many newest scans may contradict others.

    Parameters
    ----------
    drives:
        Of four seconds at least; the step is in the middle.
    """
    half = len(drives[0].scans) // 2
    shown, rows = {}, []
    for newest in NEWEST:
        tracks = {
            step: radar.step_response(
                partial(estimator.follow, newest),
                drives,
                radar.radar_filter,
                before=step[0],
                level=step[1],
            )
            for step in STEPS
        }
        rest, second = (
            _errors(tracks, slice(*scans)) for scans in ((_SECOND, half), (half, half + _SECOND))
        )
        rows.append(("never starts anew" if newest == WINDOW else str(newest), rest, second))
        if newest in (RECENT, WINDOW):
            shown[newest] = tracks
    columns = ("newest scans", "error at rest, points", "in the second after a step of 60 points")
    yield Table("Radar: newest scans that may contradict those before them", columns, tuple(rows))
    yield _picture(shown)
    yield _run_times(estimator, drives[0].scans)


def _errors(tracks: dict[tuple[float, float], NDArray[np.float64]], when: slice) -> float:
    """Return the mean error in a part of the steps, points."""
    return float(
        np.mean([np.abs(track - _truth(track, *step))[:, when] for step, track in tracks.items()])
    )


def _truth(track: NDArray[np.float64], before: float, after: float) -> NDArray[np.float64]:
    return np.where(np.arange(track.shape[1]) < track.shape[1] // 2, before, after)


def _picture(shown: dict[int, dict[tuple[float, float], NDArray[np.float64]]]) -> Picture:
    """Return the plot of the mean filtered level around a step up and a step down."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots(1, len(STEPS), sharey=True)
        for axis, step in zip(axes, STEPS, strict=True):
            for newest, name, style in (
                (RECENT, "window starts anew where contradicted", "C0"),
                (WINDOW, "window never starts anew", "C1--"),
            ):
                track = shown[newest][step].mean(axis=0)
                half = len(track) // 2
                around = slice(half - _SECOND // 2, half + 2 * _SECOND)
                scan = np.arange(len(track))[around] - half
                axis.plot(scan, track[around], style, label=name)
            axis.step(scan, np.where(scan < 0, *step), "k:", where="post", label="true")
            axis.set_xlabel("scans after the step (14 a second)")
            axis.spines[["top", "right"]].set_visible(False)
        axes[0].set_ylabel("filtered level, %")
        axes[0].legend(frameon=False, fontsize=8)

    return Picture("Radar: a step of 60 points up and down, mean of simulated drives", draw)


def _run_times(estimator: RadarEstimator, scans: Sequence[RadarScan]) -> Table:
    """Return run times at a steady level and where the window starts anew every few scans."""
    restless = [
        radar.degraded(scan, "snr", 100.0 * (number // _ALTERNATING_SCANS % 2), 0)
        for number, scan in enumerate(scans)
    ]
    rows: list[tuple[str | float, ...]] = []
    for name, own in (
        ("steady", scans),
        (f"0 and 100 % in turn, {_ALTERNATING_SCANS} scans each", restless),
    ):
        times = _run_times_us(estimator, own)
        rows.append((name, *(float(np.quantile(times, share)) for share in (0.5, 0.9, 0.99))))
    columns = ("level", "median, µs", "of the slowest tenth", "of the slowest hundredth")
    return Table("Radar: run time of one more scan", columns, tuple(rows))


def _run_times_us(estimator: RadarEstimator, scans: Sequence[RadarScan]) -> NDArray[np.float64]:
    """Return the time of every scan once the window is full, µs."""
    follow = estimator.follow()
    times = []
    for scan in scans:
        start = perf_counter()
        follow(scan)
        times.append((perf_counter() - start) * 1e6)
    return np.array(times[WINDOW:])
