"""What two successive scans show of the noise: how near echoes come back to where they were.

The earlier scan's clusters are carried to the later one's moment by the ego motion (what moves, by
its own velocity). Each is then paired with the later clusters close to it. Counts of the pairs by
their residuals, in units of the sensor's accuracy, need no decision which cluster is which: chance
pairs are spread evenly, those of one reflector crowd near 0, the more so the less noise there is.
And echoes found again, new and lost, by their power over the detection floor: what a loss takes
away is weak.
"""

from __future__ import annotations

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

PAIR_FEATURES = 3 * _CELLS + len(_APART_LIMITS) + 1 + 3 * (len(_POWER_LIMITS_DB) + 1)
"""Number of features of two scans."""


def pair_features(earlier: ScanView, later: ScanView) -> Floats:
    """Return counts, divided by the number of the later scan's clusters, (PAIR_FEATURES,).

    Pairs by residual in range and azimuth: near ones, far ones, and those that are each other's
    nearest; the last also by both residuals together. Clusters by power: found again, new, lost.
    """
    one, other, along, across = _pairs(earlier, later)
    close = np.flatnonzero((along <= _RANGE_LIMITS[-1]) & (across <= _AZIMUTH_LIMITS[-1]))
    row = np.searchsorted(_RANGE_LIMITS, along[close])
    cell = row * len(_AZIMUTH_LIMITS) + np.searchsorted(_AZIMUTH_LIMITS, across[close])
    far = ~ARS408.is_near(later.range_m[other[close]])
    widened = np.hypot(1.0, _GRID_STD_M / later.range_std)
    apart = np.hypot(along / widened[other], across)
    mutual = _least(apart, one, len(earlier)) & _least(apart, other, len(later))
    again = mutual & (along < _FOUND_AGAIN) & (across < _FOUND_AGAIN)
    found, kept = np.zeros(len(later), bool), np.zeros(len(earlier), bool)
    found[other[again]] = kept[one[again]] = True
    power, power_before = (
        np.searchsorted(_POWER_LIMITS_DB, scan.echo_db) for scan in (later, earlier)
    )
    counts = [
        np.bincount(cell + _CELLS * far, minlength=2 * _CELLS),
        np.bincount(cell[mutual[close]], minlength=_CELLS),
        np.bincount(
            np.searchsorted(_APART_LIMITS, apart[mutual]), minlength=len(_APART_LIMITS) + 1
        ),
    ]
    counts += [
        np.bincount(echoes, minlength=len(_POWER_LIMITS_DB) + 1)
        for echoes in (power[found], power[~found], power_before[~kept])
    ]
    return np.concatenate(counts) / len(later)


def _pairs(
    earlier: ScanView, later: ScanView
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats, Floats]:
    """Return indices of all close pairs, and their residuals in range and azimuth."""
    position = carried(earlier, later)
    distance = np.hypot(position[0], position[1])
    azimuth = np.arctan2(position[1], position[0])
    order = np.argsort(distance, kind="stable")
    one, other = _within_reach(distance[order], later.range_m)
    one = order[one]
    alike = np.abs(earlier.rcs[one] - later.rcs[other]) <= _ALIKE_DB
    one, other = one[alike], other[alike]
    along = np.abs(distance[one] - later.range_m[other]) / later.range_std[other]
    across = np.abs(azimuth[one] - later.azimuth[other]) / later.azimuth_std[other]
    return one, other, along, across


def carried(earlier: ScanView, later: ScanView) -> Floats:
    """Return where the earlier scan's clusters are expected in the later one, (2, n) m.

    What stands moves by the mean of both scans' ego motions, what does not by its own velocity.
    """
    elapsed_s = (later.stamp_ns - earlier.stamp_ns) * 1e-9
    first, second = earlier.motion, later.motion
    half = -(first.turn + second.turn) / 4 * elapsed_s
    shift = (
        complex(first.ahead + second.ahead, first.left + second.left)
        * (elapsed_s / 2)
        * np.exp(1j * half)
    )
    standing = (earlier.position[0] + 1j * earlier.position[1]) * np.exp(2j * half) + shift
    moving = earlier.position + earlier.velocity * elapsed_s
    return np.where(earlier.still, np.array([standing.real, standing.imag]), moving)


def _within_reach(first: Floats, second: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return all pairs of indices into two sorted rows of ranges that are close, m."""
    low = np.searchsorted(second, first - _REACH_M)
    count = np.searchsorted(second, first + _REACH_M) - low
    one = np.repeat(np.arange(len(first)), count)
    within = np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
    return one, within + np.repeat(low, count)


def _least(values: Floats, owner: NDArray[np.intp], owners: int) -> NDArray[np.bool_]:
    """Return which values are the least of their owner's."""
    least = np.full(owners, np.inf)
    np.minimum.at(least, owner, values)
    return np.asarray(values == least[owner])
