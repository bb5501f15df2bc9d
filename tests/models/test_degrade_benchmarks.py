from __future__ import annotations

import cv2

from models.evaluate import degrade, stability
from models.evaluate.report import Goal, Point


def test_nothing_fails_at_the_extremes():
    results = list(stability.run(quick=True))
    goals = [result for result in results if isinstance(result, Goal)]
    assert len(goals) == 3
    assert all(goal.met for goal in goals), goals
    for point in (result for result in results if isinstance(result, Point)):
        limit = 0.4 if point.variant.startswith("random walk") else 1e-9
        assert point.error < limit, point


def test_the_benchmark_measures_every_kind_and_leaves_opencv_as_it_was():
    before = cv2.getNumThreads()
    results = list(degrade.run(quick=True))
    assert cv2.getNumThreads() == before
    points = [result for result in results if isinstance(result, Point)]
    named = {point.variant.split(",")[0].removeprefix("radar ") for point in points}
    assert named == {kind for sensor in ("camera", "radar") for kind in degrade.load(sensor)}
    assert all(point.run_time_us > 0 and point.error >= 0 for point in points)
    accuracy = [
        r for r in results if isinstance(r, Goal) and "ms" not in r.name and "µs" not in r.name
    ]
    assert len(accuracy) == 3
    assert all(goal.met for goal in accuracy), accuracy
