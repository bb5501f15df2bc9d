"""What two successive scans show of the noise: how near echoes come back to where they were.

The earlier scan's clusters are carried to the later one's moment by the ego motion (what moves, by
its own velocity). Each is then paired with the later clusters close to it. Counts of the pairs by
their residuals, in units of the sensor's accuracy, need no decision which cluster is which: chance
pairs are spread evenly, those of one reflector crowd near 0, the more so the less noise there is.
And echoes found again, new and lost, by their power over the detection floor: what a loss takes
away is weak.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
from numpy.typing import NDArray

from models.estimate.radar_view import Floats, ScanView
from models.sensor import ARS408

_RANGE_LIMITS = np.array([0.4, 1.0, 1.8, 3.0, 5.0, 8.0, 12.0, 18.0])
_AZIMUTH_LIMITS = np.array([0.3, 0.8, 1.6, 3.0, 5.0, 8.0])
"""Limits of the residuals, in standard deviations of the sensor."""
_CELLS = len(_RANGE_LIMITS) * len(_AZIMUTH_LIMITS)
_REACH_M = float(_RANGE_LIMITS[-1]) * ARS408.far_range_std_m
_ALIKE_DB = 6.0
"""Largest difference of RCS within a pair: a wide gate, for an echo fluctuates by itself."""
_GRID_STD_M = ARS408.grid[0].step / np.sqrt(12.0)
_APART_LIMITS = np.array([0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0])
"""Limits of both residuals together."""
_FOUND_AGAIN = 8.0
"""Limit of either residual up to which an echo is found again."""
_POWER_LIMITS_DB = np.array([2.0, 5.0, 10.0, 18.0, 28.0])
_POWER_CELLS = len(_POWER_LIMITS_DB) + 1

_STARTS = np.cumsum([2 * _CELLS, _CELLS, len(_APART_LIMITS) + 1, 2 * _POWER_CELLS]).tolist()
"""Places among the features of: mutual pairs, these by distance, clusters by power, lost ones."""

PAIR_FEATURES = _STARTS[-1] + _POWER_CELLS
"""Number of features of two scans."""


def pair_features(earlier: ScanView, later: ScanView) -> Floats:
    """Return counts, divided by the number of the later scan's clusters, (PAIR_FEATURES,).

    Pairs by residual in range and azimuth: near ones, far ones, and those that are each other's
    nearest; the last also by both residuals together. Clusters by power: found again, new, lost.
    """
    one, other, along, across = _pairs(earlier, later)
    close = np.flatnonzero((along <= _RANGE_LIMITS[-1]) & (across <= _AZIMUTH_LIMITS[-1]))
    row = _RANGE_LIMITS.searchsorted(along.take(close))
    cell = row * len(_AZIMUTH_LIMITS) + _AZIMUTH_LIMITS.searchsorted(across.take(close))
    far = ~ARS408.is_near(later.range_m.take(other.take(close)))
    widened = np.sqrt(1.0 + (_GRID_STD_M / later.range_std) ** 2)
    apart = (along / widened.take(other)) ** 2 + across**2
    mutual = _least(apart, one, len(earlier)) & _least(apart, other, len(later))
    nearest = np.flatnonzero(mutual)
    again = nearest[np.maximum(along, across).take(nearest) < _FOUND_AGAIN]
    new, lost = np.ones(len(later), bool), np.ones(len(earlier), bool)
    new[other.take(again)] = lost[one.take(again)] = False
    power = _POWER_LIMITS_DB.searchsorted(later.echo_db)
    power_before = _POWER_LIMITS_DB.searchsorted(earlier.echo_db)
    of_mutual, by_distance, by_power, of_lost = _STARTS
    counted = [
        cell + _CELLS * far,
        cell[mutual.take(close)] + of_mutual,
        _APART_LIMITS.searchsorted(np.sqrt(apart.take(nearest))) + by_distance,
        power + _POWER_CELLS * new + by_power,
        power_before[lost] + of_lost,
    ]
    return np.bincount(np.concatenate(counted), minlength=PAIR_FEATURES) / len(later)


def _pairs(
    earlier: ScanView, later: ScanView
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats, Floats]:
    """Return indices of all close pairs, and their residuals in range and azimuth."""
    position = carried(earlier, later)
    distance = np.hypot(position[0], position[1])
    azimuth = np.arctan2(position[1], position[0])
    one, other = _within_reach(distance, later.range_m)
    alike = np.flatnonzero(np.abs(earlier.rcs.take(one) - later.rcs.take(other)) <= _ALIKE_DB)
    one, other = one.take(alike), other.take(alike)
    along = np.abs(distance.take(one) - later.range_m.take(other)) / later.range_std.take(other)
    across = np.abs(azimuth.take(one) - later.azimuth.take(other)) / later.azimuth_std.take(other)
    return one, other, along, across


def carried(earlier: ScanView, later: ScanView) -> Floats:
    """Return where the earlier scan's clusters are expected in the later one, (2, n) m.

    What stands moves by the mean of both scans' ego motions, what does not by its own velocity.
    """
    elapsed_s = (later.stamp_ns - earlier.stamp_ns) * 1e-9
    first, second = earlier.motion, later.motion
    turned = -(first.turn + second.turn) / 2 * elapsed_s
    mean_motion = complex(first.ahead + second.ahead, first.left + second.left) / 2
    shift = mean_motion * elapsed_s * cmath.rect(1.0, turned / 2)
    cos, sin = math.cos(turned), math.sin(turned)
    standing = np.array([[cos, -sin], [sin, cos]]) @ earlier.position
    standing += [[shift.real], [shift.imag]]
    moving = earlier.position + earlier.velocity * elapsed_s
    return np.where(earlier.still, standing, moving)


def _within_reach(first: Floats, second: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return all pairs of indices into two rows of ranges, m, that are close; the second sorted."""
    low = second.searchsorted(first - _REACH_M)
    end = second.searchsorted(first + _REACH_M)
    count = end - low
    one = np.arange(len(first)).repeat(count)
    return one, np.arange(len(one)) + (end - count.cumsum()).repeat(count)


def _least(values: Floats, owner: NDArray[np.intp], owners: int) -> NDArray[np.bool_]:
    """Return which values are the least of their owner's."""
    least = np.full(owners, np.inf)
    np.minimum.at(least, owner, values)
    return np.asarray(values == least.take(owner))
