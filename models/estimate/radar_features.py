"""What a radar scan shows of its own noise: features that know neither order nor IDs.

Quality fields are left out on purpose: a degradation may leave them as they were, and a network
that reads them would learn that instead of the noise. Positions, velocities and RCS are put on
the sensor's output grid first, so that nothing finer than the bus carries is ever seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.sensor import ARS408, RadarSensor

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

VERSION = 1
"""Version of the features' meaning; a network is only valid for the one it was trained on."""

_STATIONARY = np.isin(np.arange(256), (1, 3, 5))
"""By DynProp: stationary, stationary candidate, crossing stationary."""
_FRACTIONS = np.array([0, 0.01, 0.02, 0.04, 0.07, 0.11, 0.17, 0.25, 0.35, 0.5, 0.65, 0.8, 0.95, 1])
_ABOVE_FLOOR_DB = np.array([0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0])
_RESIDUALS = np.array([[0.13], [0.38], [0.63], [2.0]])
"""Limits of the velocity residuals, m/s: the first three between the steps of the grid."""

FEATURES = 2 + len(_FRACTIONS) + len(_ABOVE_FLOOR_DB) + 3 * len(_RESIDUALS) + 2
"""Number of features."""


def features(scan: RadarScan, sensor: RadarSensor = ARS408) -> NDArray[np.float32]:
    """Return the features of a scan in cluster mode with at least one cluster, (FEATURES,).

    Their number; the lower edge of the echoes RCS − 40 log10(range) and how many lie close above
    the sensor's detection floor; and how well the velocities agree with one ego motion.
    """
    rows = np.array([scan.x, scan.y, scan.vx, scan.vy, scan.rcs], np.float64)
    rows = sensor.rows_to_grid(np.where(np.isfinite(rows), rows, 0.0))
    order = np.lexsort((scan.dyn_prop, *rows))  # so that sums do not depend on the given order
    x, y, _, _, rcs = rows = rows[:, order]
    r = np.maximum(np.hypot(x, y), sensor.range_min_m)
    echo = np.sort(rcs - 40.0 * np.log10(r))
    floor = sensor.detection_floor_db
    groups = [
        np.array([len(r) / 125, math.log(len(r))]),
        (_quantiles(echo, _FRACTIONS) - floor) / 15,
        np.searchsorted(echo, floor + _ABOVE_FLOOR_DB).astype(np.float64) / 30,
        _doppler(rows[:2], rows[2:4], _STATIONARY[scan.dyn_prop[order]]),
    ]
    return np.concatenate(groups).astype(np.float32)


@dataclass(frozen=True, slots=True)
class EgoMotion:
    """The sensor's own motion, as stationary points show it: v = a − ω × p.

    Attributes
    ----------
    ahead, left:
        a: velocity of a stationary point at the sensor, m/s.
    turn:
        ω: yaw rate, rad/s.
    """

    ahead: float
    left: float
    turn: float

    def velocity(self, position: Floats) -> Floats:
        """Return vx and vy, m/s, of points that stand still; both (2, n)."""
        x, y = position
        return np.array([self.ahead + self.turn * y, self.left - self.turn * x])


def ego_motion(position: Floats, velocity: Floats, dyn_prop: NDArray[np.uint8]) -> EgoMotion:
    """Fit the ego motion to the stationary points; position and velocity are (2, n)."""
    return _fit_motion(position, velocity, _STATIONARY[dyn_prop])


def _quantiles(ordered: Floats, fractions: Floats) -> Floats:
    """Return linearly interpolated quantiles of sorted values (at a fifth of NumPy's time)."""
    return np.interp(fractions * (len(ordered) - 1), np.arange(len(ordered)), ordered)


def _doppler(position: Floats, velocity: Floats, still: Flags) -> Floats:
    """Return how many velocities disagree with one ego motion, and that motion's magnitude.

    Jitter shows in the share of the stationary points that leave their step of the grid; ghosts,
    whose velocity lies on the line of sight, in the number of points that move sideways.
    """
    motion = _fit_motion(position, velocity, still)
    over = np.abs(velocity - motion.velocity(position))[:, np.newaxis] > _RESIDUALS
    of_still = over[..., still].sum(axis=2) / max(1, np.count_nonzero(still))
    sideways = over[1].sum(axis=1) / 4
    speed = math.tanh(math.hypot(motion.ahead, motion.left) / 5)
    return np.array([*of_still.ravel(), *sideways, speed, math.tanh(abs(motion.turn) * 10)])


def _fit_motion(position: Floats, velocity: Floats, still: Flags) -> EgoMotion:
    """Fit the ego motion to the stationary points, or to all where fewer than three are.

    Least squares, re-weighted three times by 1 / (1 + (residual / step of the grid)²).
    """
    if np.count_nonzero(still) > 2:
        position, velocity = position[:, still], velocity[:, still]
    lever = np.array([position[1], -position[0]])
    offset = np.sort(velocity, axis=1)[:, velocity.shape[1] // 2]
    turn = 0.0
    for _ in range(3):
        residual = velocity - offset[:, np.newaxis] - turn * lever
        weight = 1.0 / (1.0 + (residual / ARS408.grid[2].step) ** 2)
        weight /= weight.sum(axis=1, keepdims=True)
        mean_lever = (weight * lever).sum(axis=1)
        weighted = weight * (lever - mean_lever[:, np.newaxis])
        # 1 m² more of spread: no turn is read from clusters at one spot.
        turn = float((weighted * velocity).sum() / ((weighted * lever).sum() + 1.0))
        offset = (weight * velocity).sum(axis=1) - turn * mean_lever
    return EgoMotion(float(offset[0]), float(offset[1]), turn)
