from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.nuscenes import POINT, CloudScan, RadarCloud, new_cloud, scan_of, with_scan
from models.degrade import radar
from models.degrade.compensation import compensate, ego_velocity
from models.degrade.draw import DrawKey


def world_points(rng: np.random.Generator, n: int, ego: Any) -> tuple[Any, Any]:
    """Return points of a radar that moves with ``ego``, and their velocity over ground, radial."""
    points = np.zeros(n, POINT)
    points["x"], points["y"] = rng.uniform(5, 100, n), rng.uniform(-40, 40, n)
    sight = np.column_stack([points["x"], points["y"]]).astype(float)
    sight /= np.hypot(*sight.T)[:, None]
    ground = rng.normal(0, 8, n) * (rng.random(n) < 0.5)
    relative = ground - sight @ ego
    points["vx"], points["vy"] = (relative[:, None] * sight).T
    points["vx_comp"], points["vy_comp"] = (ground[:, None] * sight).T
    return points, ground


@given(
    seed=st.integers(0, 1000),
    n=st.integers(2, 125),
    vx=st.floats(-20, 60),
    vy=st.floats(-5, 5),
)
def test_the_ego_velocity_is_found(seed: int, n: int, vx: float, vy: float) -> None:
    rng = np.random.default_rng(seed)
    points, _ = world_points(rng, n, np.array([vx, vy]))
    azimuth = np.arctan2(points["y"], points["x"])
    tolerance = 1e-4 / max(np.ptp(azimuth), 1e-3)
    np.testing.assert_allclose(ego_velocity(points), [vx, vy], atol=tolerance)


def test_without_points_the_ego_stands() -> None:
    assert ego_velocity(np.zeros(0, POINT)).tolist() == [0, 0]


def degraded(cloud: RadarCloud, kind: str, level: float, sequence: int) -> tuple[Any, CloudScan]:
    scan = scan_of(cloud, "radar", sequence, Path("a.pcd"))
    drawn = radar.draw(kind, level, DrawKey(1, "radar", sequence))
    changed: Any = radar.apply(drawn, scan)
    return compensate(cloud, with_scan(cloud, changed), changed.place).points, changed


def test_a_ghost_that_stands_has_no_velocity_over_ground() -> None:
    ego = np.array([15.0, 0.5])
    points, _ = world_points(np.random.default_rng(1), 60, ego)
    points = points[np.hypot(points["vx_comp"], points["vy_comp"]) < 1e-6]
    points = points[np.argsort(np.hypot(points["x"], points["y"]))]
    cloud = new_cloud(points)
    scan = scan_of(cloud, "radar", 0, Path("a.pcd"))
    ghost = {"x": 50.0, "y": 0.0, "vx": -ego[0], "vy": 0.0}
    moved = replace(scan, **{k: np.full(len(scan), v, np.float32) for k, v in ghost.items()})
    after = compensate(cloud, with_scan(cloud, moved), moved.place).points
    np.testing.assert_allclose(after["vx_comp"], 0, atol=1e-4)
    np.testing.assert_allclose(after["vy_comp"], 0, atol=1e-4)


def test_missed_detections_leave_the_other_points_as_they_were() -> None:
    points, _ = world_points(np.random.default_rng(2), 100, np.array([9.0, 0.0]))
    points = points[np.argsort(np.hypot(points["x"], points["y"]))]
    for name in ("x", "y", "vx", "vy"):
        grid = radar.ARS408.to_grid(name, points[name])
        points[name] = grid
    after, scan = degraded(new_cloud(points), "missed", 100, 0)
    assert 0 < len(after) < len(points)
    before = points[scan.place]
    for name in POINT.names or ():
        if name != "id":
            assert after[name].tobytes() == before[name].tobytes(), name


@pytest.mark.parametrize("kind", ["snr", "ghosts"])
def test_real_scans_keep_a_radial_compensated_velocity(data: Path, kind: str) -> None:
    archive = np.load(data / "radar" / "nuscenes_mini" / "scene-0061.npz")
    offsets = archive["offsets"]
    for sequence, (first, last) in enumerate(pairwise(offsets[:6])):
        points = np.zeros(last - first, POINT)
        for column, name in enumerate(archive["fields"]):
            points[str(name)] = archive["points"][first:last, column]
        cloud = new_cloud(points)
        after, _ = degraded(cloud, kind, 100, sequence)
        ego = ego_velocity(points)
        sight = np.column_stack([after["x"], after["y"]]).astype(float)
        sight /= np.hypot(*sight.T)[:, None]
        radial = after["vx"] * sight[:, 0] + after["vy"] * sight[:, 1]
        expected = (radial + sight @ ego)[:, None] * sight
        found = np.column_stack([after["vx_comp"], after["vy_comp"]])
        np.testing.assert_allclose(found, expected, atol=1e-5)
