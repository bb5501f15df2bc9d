"""The evidence of a radar's noise in a scan and the scans before it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.estimate.radar_features import FEATURES, features
from models.estimate.radar_pairs import PAIR_FEATURES, pair_features
from models.estimate.radar_view import Floats, ScanView, view

VERSION = 2
"""Version of the inputs' meaning; a network is only valid for the one it was trained on."""

WINDOW = 14
"""Most scans taken together: a second of an ARS 408."""

MAX_GAP_S = 1.0
"""Silence after which a window starts anew, s: the scenery is another."""

SHORTEST_CYCLE_S, LONGEST_CYCLE_S = 0.055, 0.095
"""Bounds of the time from one measurement to the next by the radar's own counter, s: it takes 70 to
80 ms. A recording that is played much faster or slower onto a bus is beyond them."""
_COUNTS = 1 << 16
_USUAL_STEP = 2
"""By which MeasCounter rises in a cycle, as long as no odd difference tells that it is 1."""

_TYPICAL_GAP_S = 0.2
_SHORTEST_GAP_S = 0.01

INPUTS = FEATURES + PAIR_FEATURES + 3
"""Number of inputs of the network."""

FOLLOWS = FEATURES + PAIR_FEATURES
"""Place of the input that is 1 for a scan with others before it and 0 for a scan alone."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What one scan adds to a window.

    Attributes
    ----------
    view:
        The scan.
    features:
        Of the scan alone, (FEATURES,).
    pairs:
        Of the scan before and this one, (PAIR_FEATURES,); zeros in the first of a window.
    elapsed_s:
        Since the scan before, s; 0 in the first of a window.
    """

    view: ScanView
    features: Floats
    pairs: Floats
    elapsed_s: float


def evidence(scan: RadarScan, before: Evidence | None) -> Evidence:
    """Return what a scan of at least one cluster shows after another one, or as the first."""
    own = view(scan)
    elapsed_s = (own.stamp_ns - before.view.stamp_ns) * 1e-9 if before else 0.0
    pairs = pair_features(before.view, own) if before else np.zeros(PAIR_FEATURES)
    return Evidence(own, features(own), pairs, elapsed_s)


def inputs(window: list[Evidence] | deque[Evidence]) -> NDArray[np.float32]:
    """Return the network's inputs from one scan or successive ones, (INPUTS,).

    Means over the window: one over its scans, one over its pairs of successive scans (square
    roots of the counts, whose noise is then alike), and how many scans of what spacing they are.
    The pairs before the window's first scan do not count.
    """
    scans = list(window)
    later = scans[1:]
    alone = _mean([each.features for each in scans])
    if later:
        pairs = np.sqrt(_mean([each.pairs for each in later]))
        spacing_s = max(sum(each.elapsed_s for each in later) / len(later), _SHORTEST_GAP_S)
        spacing = math.log(spacing_s / _TYPICAL_GAP_S)
    else:
        pairs, spacing = np.zeros(PAIR_FEATURES), 0.0
    extent = [float(bool(later)), math.log(len(scans)), spacing]
    return np.concatenate([alone, pairs, extent], dtype=np.float32)


def _mean(rows: list[Floats]) -> Floats:
    """Return the mean of rows (at half of NumPy's time)."""
    return np.asarray(np.add.reduce(rows) / len(rows))


class ScanWindow:
    """The last scans of one sensor, no more than ``WINDOW``.

    A scan that comes after a silence of more than ``MAX_GAP_S``, or with no later a stamp than the
    one before it, starts a new window; so does the first after a scan without clusters. Where the
    stamps do not run with the radar's own counter, how far things have moved between scans is not
    known, and every scan stands alone.
    """

    def __init__(self) -> None:
        self._scans: deque[Evidence] = deque(maxlen=WINDOW)
        self._counters: deque[int] = deque(maxlen=WINDOW)
        self._step = _USUAL_STEP

    def add(self, scan: RadarScan) -> NDArray[np.float32] | None:
        """Take in the next scan; return the network's inputs, or None where it is empty."""
        if not len(scan) or (self._scans and not self._goes_on(scan)):
            self._scans.clear()
            self._counters.clear()
        if not len(scan):
            return None
        self._scans.append(evidence(scan, self._scans[-1] if self._scans else None))
        self._counters.append(scan.meas_counter)
        return inputs(self._scans)

    def _goes_on(self, scan: RadarScan) -> bool:
        """Tell whether a scan goes on with the window's."""
        first, last = self._scans[0].view, self._scans[-1].view
        if not 0.0 < (scan.stamp_ns - last.stamp_ns) * 1e-9 <= MAX_GAP_S:
            return False
        counts = (scan.meas_counter - self._counters[0]) % _COUNTS
        if not counts:  # a counter that stands still tells nothing
            return True
        if counts % _USUAL_STEP:
            self._step = 1
        cycle_s = (scan.stamp_ns - first.stamp_ns) * 1e-9 * self._step / counts
        return SHORTEST_CYCLE_S <= cycle_s <= LONGEST_CYCLE_S
