from __future__ import annotations

import sys

import cv2
import numpy as np
import pytest

from dbc.errors import InputError
from models.degrade.kinds import KINDS
from models.evaluate import degrade, stability
from models.evaluate.peers import compare
from models.evaluate.report import Goal, Point


def test_nothing_fails_at_the_extremes():
    results = list(stability.run(quick=True))
    goals = [result for result in results if isinstance(result, Goal)]
    assert len(goals) == 3
    assert all(goal.met for goal in goals), goals
    for point in (result for result in results if isinstance(result, Point)):
        limit = 0.4 if point.variant.startswith("random walk") else 1e-9
        assert point.error < limit, point


def test_the_benchmark_measures_every_kind_and_leaves_opencv_as_it_was(monkeypatch):
    monkeypatch.delenv("MURK_PEERS", raising=False)
    before = cv2.getNumThreads()
    results = list(degrade.run(quick=True))
    assert cv2.getNumThreads() == before
    points = [result for result in results if isinstance(result, Point)]
    named = {point.variant.split(",")[0].removeprefix("radar ") for point in points}
    assert named == {kind for kinds in KINDS.values() for kind in kinds}
    assert all(point.run_time_us > 0 and point.error >= 0 for point in points)
    accuracy = [
        r for r in results if isinstance(r, Goal) and "ms" not in r.name and "µs" not in r.name
    ]
    assert len(accuracy) == 3
    assert all(goal.met for goal in accuracy), accuracy


def test_peers_are_compared_where_they_are(monkeypatch, tmp_path):
    """A stand-in for another library's package, in this interpreter."""
    package = tmp_path / "imagecorruptions.py"
    package.write_text("def corrupt(image, corruption_name, severity):\n    return image.copy()\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("MURK_PEERS", sys.executable)
    own = dict.fromkeys(KINDS["camera"], 1e-3)
    goals = list(compare(np.zeros((9, 16, 3), np.uint8), own, quick=True))
    assert {goal.goal for goal in goals} == {20.0}
    assert all("imagecorruptions" in goal.name and goal.met for goal in goals)
    monkeypatch.setenv("MURK_PEERS", str(tmp_path / "no-python"))
    with pytest.raises(InputError, match="MURK_PEERS"):
        list(compare(np.zeros((9, 16, 3), np.uint8), own, quick=True))
