"""Radar: how near the estimates come to the truth, and what they cost.

Drives of the simulated world that no training saw, degraded by `snr` at all eleven levels; on
recorded drives the shipped network has no honest figure, since it was trained on all of them: the
card beside it has those of drives left out. The error is the mean distance of the mean level from
the true one. Filters are measured on simulated drives whose level steps from 0 to 60 %: the error
after the step over the rate at which the filter lets the level drift.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from time import perf_counter_ns

import numpy as np

from models.estimate.filter import FloatArray, LevelFilter
from models.estimate.level import LEVELS
from models.estimate.radar import RadarEstimator
from models.evaluate import radar
from models.evaluate.report import Goal, Point, Result
from models.evaluate.timing import median_us

UNIT = "points of level, radar"
FILTER_UNIT = "points of level, filter"
SIMULATED = range(2**31 + 100, 2**31 + 104)
"""Seeds of simulated drives; training draws only seeds below 2**31."""
SECOND = 14
STEP_SCANS = 112
DRIFTS_PER_S = (0.01, 0.05, 0.2, 1.0, 5.0)


def run(quick: bool) -> Iterator[Result]:
    """Measure the shipped network and the filter's rates."""
    yield from _network(quick)
    yield from _filters(quick)


def _network(quick: bool) -> Iterator[Point | Goal]:
    estimator = RadarEstimator()
    scans = 2 * SECOND if quick else 10 * SECOND
    drives = [radar.simulated_drive(seed, 0, scans) for seed in _seeds(quick)]
    scan = drives[0].scans[0]
    run_time_us = median_us(lambda: estimator.estimate(scan), 20 if quick else 200)
    one = radar.measure(estimator.estimate, drives, draws=1).figures()
    yield Point("radar network", "one scan", run_time_us, one["mean_error"], UNIT)
    second = radar.measure_together(
        estimator.estimate, drives, radar.radar_filter, scans=SECOND, draws=1
    ).figures()
    yield Point("radar network", "one second", SECOND * run_time_us, second["mean_error"], UNIT)
    yield Goal("radar, 125 clusters, one thread, ms", run_time_us / 1e3, 0.3, False)
    yield Goal("radar, one simulated scan, right, %", 100 * one["accuracy"], 40.0)
    yield Goal("radar, one simulated scan, mean error, points", one["mean_error"], 10.0, False)
    yield Goal("radar, one simulated second, right, %", 100 * second["accuracy"], 75.0)
    yield Goal("radar, one simulated second, mean error, points", second["mean_error"], 4.0, False)


def _filters(quick: bool) -> Iterator[Point | Goal]:
    estimator = RadarEstimator()
    drives = [radar.simulated_drive(seed, 0, STEP_SCANS) for seed in _seeds(quick)]
    half = STEP_SCANS // 2
    for drift in DRIFTS_PER_S:
        make_filter = partial(LevelFilter, drift, 0.05, 0.1)
        uniform = np.full(len(LEVELS), 1 / len(LEVELS))
        update = make_filter().update
        run_time_us = median_us(partial(_update, update, uniform), 50)
        levels = radar.step_response(estimator.estimate, drives, make_filter, level=60.0)
        for name, error in (
            ("at rest", np.abs(levels[:, SECOND:half]).mean()),
            ("a second after the step", np.abs(levels[:, half + SECOND :] - 60.0).mean()),
        ):
            yield Point(
                f"filter, {name}", f"drift={drift}/s", run_time_us, float(error), FILTER_UNIT
            )


def _seeds(quick: bool) -> range:
    return SIMULATED[:1] if quick else SIMULATED


def _update(update: Callable[[int, FloatArray], FloatArray], measured: FloatArray) -> None:
    update(perf_counter_ns(), measured)
