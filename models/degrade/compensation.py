"""The velocity over ground of degraded clusters, for data sets that hold it.

A cluster's compensated velocity is a vector along the line of sight r̂:
v_comp = (v · r̂ + v_ego · r̂) r̂, where v is what the radar measures and v_ego how it moves itself.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.nuscenes import RadarCloud

FloatArray = NDArray[np.float64]


def ego_velocity(points: NDArray[np.void]) -> FloatArray:
    """Return how the radar moves, (2,) m/s, from (v_comp - v) · r̂ = v_ego · r̂ in least squares.

    Where the points do not determine it (fewer than two directions) it is the shortest solution.

    Parameters
    ----------
    points:
        (n,) of ``drivers.nuscenes.POINT``.
    """
    radial, sight = _radial(points, "vx", "vy")
    compensated, _ = _radial(points, "vx_comp", "vy_comp")
    gained = compensated - radial
    usable = np.isfinite(gained) & np.isfinite(sight).all(axis=1)
    solution, *_ = np.linalg.lstsq(sight[usable], gained[usable], rcond=None)
    return np.asarray(solution)


def compensate(original: RadarCloud, degraded: RadarCloud, place: NDArray[Any]) -> RadarCloud:
    """Return the degraded cloud with the compensated velocity of every point that moved.

    A point that is where it was, as fast as it was, keeps what the file said.

    Parameters
    ----------
    original, degraded:
        The cloud before and after.
    place:
        (n,) which point of the original each one comes from.
    """
    points = degraded.points.copy()
    before = original.points[place]
    moved = np.zeros(len(points), bool)
    for name in ("x", "y", "vx", "vy"):
        moved |= points[name] != before[name]
    radial, sight = _radial(points, "vx", "vy")
    over_ground = (radial + sight @ ego_velocity(original.points))[:, None] * sight
    points["vx_comp"][moved], points["vy_comp"][moved] = over_ground[moved].T
    return replace(degraded, points=points)


def _radial(points: NDArray[np.void], vx: str, vy: str) -> tuple[FloatArray, FloatArray]:
    """Return the radial part of a velocity, (n,) m/s, and the lines of sight, (n, 2)."""
    position = np.column_stack([points["x"], points["y"]]).astype(np.float64)
    distance = np.hypot(position[:, 0], position[:, 1])
    sight = position / np.maximum(distance, 1e-9)[:, None]
    velocity = np.column_stack([points[vx], points[vy]]).astype(np.float64)
    return (velocity * sight).sum(axis=1), sight
