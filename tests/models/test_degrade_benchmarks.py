from __future__ import annotations

import sys

import cv2
import numpy as np
import pytest

from dbc.errors import InputError
from models.degrade.kinds import KINDS
from models.evaluate import degrade, peers, stability
from models.evaluate.report import Goal, Point, Table
from models.evaluate.samples import textured_image


def test_nothing_fails_at_the_extremes():
    results = list(stability.run(quick=True))
    goals = [result for result in results if isinstance(result, Goal)]
    assert len(goals) == 6
    assert all(goal.met for goal in goals), goals
    limits = {"relative": 1e-9, "dB": 1e-9, "counts": 1.6, "relative, of so many": 0.4}
    limits |= {"m, m/s or dBm²": 1e-4}  # float32 at the grid's ends
    by_kind = {"motion": 20, "jpeg": 60, "fog": 4}  # see the module's text
    measured = set()
    for point in (result for result in results if isinstance(result, Point)):
        kind = point.variant.partition(",")[0]
        measured.add(kind)
        assert point.error < by_kind.get(kind, limits[point.unit]), point
    assert measured >= {kind for kinds in KINDS.values() for kind in kinds}


def test_the_benchmark_measures_every_kind_and_leaves_opencv_as_it_was():
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
    assert len(accuracy) == 4
    (codec,) = (r for r in results if isinstance(r, Table) and r.title.startswith("JPEG"))
    for *_, encoding, decoding, whole, overhead in codec.rows:
        assert encoding + decoding == pytest.approx(whole, rel=0.5)
        assert whole == pytest.approx((encoding + decoding) * (1 + overhead / 100))
    (radar,) = (r for r in results if isinstance(r, Table) and r.title.startswith("Radar"))
    assert {row[0] for row in radar.rows} == set(KINDS["radar"])
    assert all(goal.met for goal in accuracy if "beats" not in goal.name), accuracy


def test_peers_are_compared_where_they_are(monkeypatch, tmp_path):
    """A stand-in for another library's package, in this interpreter."""
    package = tmp_path / "imagecorruptions"
    package.mkdir()
    (package / "corruptions.py").touch()
    (package / "__init__.py").write_text(
        "import time\n"
        "def corrupt(image, corruption_name, severity):\n"
        "    end = time.thread_time() + 0.01\n"
        "    while corruption_name != 'fog' and time.thread_time() < end: pass\n"
        "    if corruption_name == 'snow': raise TypeError('no snow today')\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("MURK_PEERS", sys.executable)
    image = np.zeros((90, 160, 3), np.uint8)
    table, goal, codec = peers.compare(image, sys.executable, quick=True)
    assert isinstance(table, Table)
    assert isinstance(goal, Goal)
    assert isinstance(codec, Goal)
    rows = {row[2].removeprefix("imagecorruptions "): row for row in table.rows}
    assert rows["gaussian_noise"][3] == pytest.approx(10, rel=0.5)
    assert rows["gaussian_noise"][4] == pytest.approx(10 / rows["gaussian_noise"][1], rel=0.5)
    assert "no snow today" in rows["snow"][3]
    assert "fog" in goal.name
    assert (goal.goal, goal.met) == (20.0, False)
    assert "same codec" in codec.name
    assert "jpeg" in codec.name


def test_codecs_of_the_same_library_give_our_picture():
    """Those of this interpreter."""
    found = peers.codecs(textured_image(90, 160), sys.executable, quick=True)
    rows = {(codec, quality): times for codec, quality, *times in found.rows}
    qualities = {quality for _, quality in rows}
    assert len(qualities) == 2
    for codec in ("OpenCV", "Pillow, as imagecorruptions calls it"):
        for quality in qualities:
            encoding, decoding, difference = rows[codec, quality]
            assert encoding > 0
            assert decoding > 0
            assert difference == 0


def test_without_peers_nothing_is_compared_and_a_wrong_one_is_named(monkeypatch, tmp_path):
    monkeypatch.delenv("MURK_PEERS", raising=False)
    assert list(peers.run(quick=True)) == []
    monkeypatch.setenv("MURK_PEERS", str(tmp_path / "no-python"))
    with pytest.raises(InputError, match="MURK_PEERS"):
        list(peers.run(quick=True))
