"""What could be known of a scan's loss at all: the best test with the clean scan in hand.

Nobody has the clean scan; whoever had it, and the law of the degradation too, could only compare
likelihoods: which clusters are gone, by their power over the threshold, and how far each that is
left has moved. Without the places of a clean scan, or of another scan, moves cannot be seen: for a
single scan the loss alone is the bound, and where even this test fails, the information is not
there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.degrade.radar import echo_db, std_growth, threshold_db
from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.estimate.network import softmax
from models.estimate.radar_view import Floats, ScanView, view
from models.evaluate.radar import Answers, Drive, degraded, gather
from models.sensor import ARS408

_DROPS_DB = LEVELS / 10.0
"""The default loss, 10 dB at 100 %."""
_REACH = 6.0
"""Standard deviations at 100 % beyond which a cluster is not taken for another that moved."""
_LEAST = 1e-4
"""Least probability of anything: where a scan is full, ghosts push others out."""
_IMPOSSIBLE = -1e6

_phi = np.frompyfunc(lambda z: 0.5 * math.erfc(-z / math.sqrt(2.0)), 1, 1)


def with_clean_scan(
    drives: Sequence[Drive], *, scans: int, draws: int, moves: bool, seed: int = 0
) -> Answers:
    """Return the test's answers to ``scans`` successive scans at one level, all levels alike.

    The sequences follow each other without overlap, as in ``measure_together``; the losses of
    successive scans are independent, so their likelihoods multiply.

    Parameters
    ----------
    moves:
        Whether the test sees how far clusters have moved, or only which are gone.
    """
    kinds = dict.fromkeys(RADAR_KINDS, 0.0) | {"snr": 1.0}
    answers = []
    for index, drive in enumerate(drives):
        for first in range(0, len(drive.scans) - scans + 1, scans):
            for repeat in range(draws):
                for level in LEVELS:
                    log = sum(
                        log_likelihood(
                            scan, degraded(scan, "snr", level, seed + repeat), moves=moves
                        )
                        for scan in drive.scans[first : first + scans]
                    )
                    answers.append(
                        (index, "snr", float(level), Estimate(softmax(np.asarray(log)), kinds))
                    )
    return gather(answers)


def log_likelihood(clean: RadarScan, scan: RadarScan, *, moves: bool) -> NDArray[np.float64]:
    """Return the logarithm of the likelihood of each level of ``snr``, (11,), but for a constant.

    ``scan`` is what became of ``clean``. Ghosts are alike at every level above 0 and do not count.
    """
    result = np.zeros(len(LEVELS))
    if moves and _same(clean, scan):
        result[1:] = _IMPOSSIBLE  # so many clusters are never all left as they were
        return result
    before, after = view(clean), view(scan)
    kept, now = _matched(before, after)
    if moves or len(kept) < len(before):
        result[0] = _IMPOSSIBLE
    echoes = echo_db(before.range_m, before.rcs)
    margin = echoes - threshold_db(echoes)
    gone = np.setdiff1d(np.arange(len(before)), kept)
    for place, level in enumerate(LEVELS):
        if level == 0:
            continue
        z = (1.0 - 10.0 ** ((margin - _DROPS_DB[place]) / 10.0)) / (level / 100.0)
        missed = np.clip(_phi(z).astype(np.float64), _LEAST, 1.0 - _LEAST)
        result[place] = np.log(missed[gone]).sum() + np.log1p(-missed[kept]).sum()
        if moves:
            growth = float(std_growth(_DROPS_DB[place]))
            result[place] += _log_moved(before, after, kept, now, growth).sum()
    return result


def _same(clean: RadarScan, scan: RadarScan) -> bool:
    return len(clean) == len(scan) and all(
        np.array_equal(getattr(clean, name), getattr(scan, name))
        for name in ("x", "y", "vx", "vy", "rcs", "dyn_prop")
    )


def _matched(before: ScanView, after: ScanView) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return indices of clusters before and after that are the same: the nearest of equal RCS."""
    growth = float(std_growth(_DROPS_DB[-1]))
    step = ARS408.grid[0].step
    along = (before.range_m[:, np.newaxis] - after.range_m) / np.hypot(
        growth * before.range_std, step
    )[:, np.newaxis]
    across = (before.azimuth[:, np.newaxis] - after.azimuth) / np.hypot(
        growth * before.azimuth_std, step / before.range_m
    )[:, np.newaxis]
    apart = np.hypot(along, across)
    apart[before.rcs[:, np.newaxis] != after.rcs] = np.inf
    one, other = np.nonzero(apart < _REACH)
    pairs = []
    free_before, free_after = np.ones(len(before), bool), np.ones(len(after), bool)
    for pair in np.argsort(apart[one, other], kind="stable"):
        i, j = one[pair], other[pair]
        if free_before[i] and free_after[j]:
            free_before[i] = free_after[j] = False
            pairs.append((i, j))
    kept, now = np.array(pairs, np.intp).reshape(-1, 2).T
    return kept, now


def _log_moved(
    before: ScanView,
    after: ScanView,
    kept: NDArray[np.intp],
    now: NDArray[np.intp],
    growth: float,
) -> Floats:
    """Return the log probability that each kept cluster lands in its cell of the bus's grid.

    Position: a normal density, widened by both ends' rounding, times the cell's area. Velocity:
    the probability of the step of the component that the line of sight moves more.
    """
    step, rounding = ARS408.grid[0].step, ARS408.grid[0].step ** 2 / 12
    distance = before.range_m[kept]
    along = after.range_m[now] - distance
    across = (after.azimuth[now] - before.azimuth[kept]) * distance
    variances = (
        (growth * before.range_std[kept]) ** 2 + rounding,
        (growth * before.azimuth_std[kept] * distance) ** 2 + rounding,
    )
    log = np.full(len(kept), 2 * np.log(step))
    for moved, variance in zip((along, across), variances, strict=True):
        log -= 0.5 * (moved**2 / variance + np.log(2 * np.pi * variance))
    cos = before.position[:, kept] / distance
    larger = np.abs(cos).argmax(axis=0), np.arange(len(kept))
    faster = (after.velocity[:, now] - before.velocity[:, kept])[larger]
    std = growth * ARS408.velocity_std * np.abs(cos[larger])
    half = ARS408.grid[2].step / 2
    cell = (_phi((faster + half) / std) - _phi((faster - half) / std)).astype(np.float64)
    return np.asarray(log + np.log(np.maximum(cell, _LEAST)))
