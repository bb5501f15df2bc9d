"""How the estimator reads a radar scan: nothing that an injection could betray itself by.

Quality fields are left out on purpose: a degradation may leave them as they were, and a network
that reads them would learn that instead of the noise. Positions, velocities and RCS are put on
the sensor's output grid, so that nothing finer than the bus carries is ever seen; clusters come in
an order of their own, and their IDs are gone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.sensor import ARS408, RadarSensor

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_STATIONARY = np.isin(np.arange(256), (1, 3, 5))
"""By DynProp: stationary, stationary candidate, crossing stationary."""
_STEP_2 = ARS408.grid[2].step ** 2
_DIGITS = np.cumprod([1] + [field.count for field in ARS408.grid[:0:-1]])[::-1] / [
    field.step for field in ARS408.grid
]
"""Weights that make one number of x, y, vx, vy and RCS on the grid, each a digit of it."""


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


@dataclass(frozen=True, slots=True, eq=False)
class ScanView:
    """The clusters of one scan, sorted by range; (n,) float64 unless said, n at least 1.

    Attributes
    ----------
    stamp_ns:
        Moment of capture, integer nanoseconds.
    position, velocity:
        (2, n), m and m/s, in the sensor's frame.
    rcs:
        dBm².
    range_m, azimuth:
        m, at least the sensor's minimum; rad.
    echo_db:
        RCS − 40 log10(range) over the sensor's detection floor, dB (radar equation).
    range_std, azimuth_std:
        The sensor's accuracy there, m and rad.
    still:
        Which the sensor takes for stationary, bool.
    motion:
        The sensor's own, by its stationary clusters.
    """

    stamp_ns: int
    position: Floats
    velocity: Floats
    rcs: Floats
    range_m: Floats
    azimuth: Floats
    echo_db: Floats
    range_std: Floats
    azimuth_std: Floats
    still: Flags
    motion: EgoMotion

    def __len__(self) -> int:
        return len(self.rcs)


def view(scan: RadarScan, sensor: RadarSensor = ARS408) -> ScanView:
    """Return the view of a scan in cluster mode with at least one cluster."""
    rows = np.array([scan.x, scan.y, scan.vx, scan.vy, scan.rcs], np.float64)
    rows = sensor.rows_to_grid(np.where(np.isfinite(rows), rows, 0.0))
    distance = np.hypot(rows[0], rows[1])
    order = np.lexsort((_DIGITS @ rows, distance))
    rows = rows.take(order, axis=1)
    distance = np.maximum(distance.take(order), sensor.range_min_m)
    azimuth = np.arctan2(rows[1], rows[0])
    still = _STATIONARY.take(scan.dyn_prop.take(order))
    return ScanView(
        stamp_ns=scan.stamp_ns,
        position=rows[:2],
        velocity=rows[2:4],
        rcs=rows[4],
        range_m=distance,
        azimuth=azimuth,
        echo_db=rows[4] - 40.0 * np.log10(distance) - sensor.detection_floor_db,
        range_std=sensor.range_std(distance),
        azimuth_std=sensor.azimuth_std(distance, azimuth),
        still=still,
        motion=_fit_motion(rows[:2], rows[2:4], still),
    )


def _fit_motion(position: Floats, velocity: Floats, still: Flags) -> EgoMotion:
    """Fit the ego motion to the stationary points, or to all where fewer than three are.

    Least squares, re-weighted three times by 1 / (1 + (residual / step of the grid)²).
    """
    chosen = np.flatnonzero(still)
    if len(chosen) > 2:
        position, velocity = position.take(chosen, axis=1), velocity.take(chosen, axis=1)
    n = position.shape[1]
    terms = np.ones((2, 3, n))  # of vx and of vy: 1, lever of the turn, velocity
    terms[0, 1], terms[1, 1] = position[1], -position[0]
    terms[:, 2] = velocity
    transposed = terms.transpose(0, 2, 1)
    ahead, left = np.sort(velocity, axis=1)[:, n // 2].tolist()
    turn = 0.0
    for _ in range(3):
        unlikely = np.array([[[-ahead, -turn, 1.0]], [[-left, -turn, 1.0]]]) @ terms
        unlikely *= unlikely
        unlikely += _STEP_2
        moments = ((terms / unlikely) @ transposed).tolist()
        (lever_x, vx, spread_x, with_x), (lever_y, vy, spread_y, with_y) = map(_moments, moments)
        # 1 m² more of spread: no turn is read from clusters at one spot.
        turn = (with_x + with_y) / (spread_x + spread_y + 1.0)
        ahead, left = vx - turn * lever_x, vy - turn * lever_y
    return EgoMotion(ahead, left, turn)


def _moments(sums: list[list[float]]) -> tuple[float, float, float, float]:
    """Return means of lever and velocity, the lever's variance, and the covariance of both."""
    (total, lever, velocity), (_, squared, product), _ = sums
    lever, velocity = lever / total, velocity / total
    return lever, velocity, squared / total - lever**2, product / total - lever * velocity
