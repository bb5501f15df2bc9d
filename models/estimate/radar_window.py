"""The evidence of a radar's noise in a scan and the scans before it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.estimate.level import Estimate
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

RECENT = 2
"""Newest scans that must not contradict what those before them said, or the window starts anew with
them: the least that show a move."""

CONTRADICTIONS = 2
"""How often in a row they may not: a single one can be chance."""

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
    row:
        Features of the scan alone, then of the scan before and this one (zeros in the first of a
        window), (FEATURES + PAIR_FEATURES,).
    """

    view: ScanView
    row: Floats


def evidence(scan: RadarScan, before: Evidence | None) -> Evidence:
    """Return what a scan of at least one cluster shows after another one, or as the first."""
    own = view(scan)
    pairs = pair_features(before.view, own) if before else np.zeros(PAIR_FEATURES)
    return Evidence(own, np.concatenate([features(own), pairs]))


def inputs(scans: Sequence[Evidence], *lengths: int) -> NDArray[np.float32]:
    """Return the network's inputs from the last of successive scans, so many each time.

    Means over the window: one over its scans, one over its pairs of successive scans (square
    roots of the counts, whose noise is then alike), and how many scans of what spacing they are.
    The pairs before the window's first scan do not count.

    Returns
    -------
    (len(lengths), INPUTS)
    """
    of_scans, of_pairs = _weights(len(scans), lengths)
    rows = np.array([each.row for each in scans])
    result = np.empty((len(lengths), INPUTS), np.float32)
    result[:, :FEATURES] = of_scans @ rows[:, :FEATURES]
    result[:, FEATURES:FOLLOWS] = np.sqrt(of_pairs @ rows[:, FEATURES:])
    for place, length in enumerate(lengths):
        elapsed_ns = scans[-1].view.stamp_ns - scans[-length].view.stamp_ns
        result[place, FOLLOWS:] = extent(elapsed_ns, length)
    return result


@cache
def _weights(scans: int, lengths: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Return weights that make means over the last scans, and over the pairs within them."""
    before_last = np.arange(scans)[::-1]
    length = np.array(lengths)[:, np.newaxis]
    return (before_last < length) / length, (before_last < length - 1) / np.maximum(length - 1, 1)


def extent(elapsed_ns: int, length: int) -> tuple[float, float, float]:
    """Return whether there is more than one scan, how many, and of what spacing they are.

    The last two as logarithms of the number and of the spacing over 0.2 s; zeros for one scan.
    """
    if length == 1:
        return 0.0, 0.0, 0.0
    spacing_s = max(elapsed_ns * 1e-9 / (length - 1), _SHORTEST_GAP_S)
    return 1.0, math.log(length), math.log(spacing_s / _TYPICAL_GAP_S)


class ScanWindow:
    """The last scans of one sensor, no more than ``WINDOW``.

    A scan that comes after a silence of more than ``MAX_GAP_S``, or with no later a stamp than the
    one before it, starts a new window; so does the first after a scan without clusters. Where the
    stamps do not run with the radar's own counter, how far things have moved between scans is not
    known, and every scan stands alone.

    Parameters
    ----------
    recent:
        Number of newest scans whose inputs are given beside the whole window's.
    """

    def __init__(self, recent: int = RECENT) -> None:
        self._recent = recent
        self._said: deque[Estimate] = deque(maxlen=recent)
        self._scans: deque[Evidence] = deque(maxlen=WINDOW)
        self._counters: deque[int] = deque(maxlen=WINDOW)
        self._step = _USUAL_STEP
        self._contradictions = 0

    def add(self, scan: RadarScan) -> NDArray[np.float32] | None:
        """Take in the next scan; return the network's inputs, or None where it is empty.

        Returns
        -------
        (2, INPUTS): of the whole window, and of its ``recent`` newest scans.
        """
        if not len(scan) or (self._scans and not self._goes_on(scan)):
            self._forget_all_but(0)
        if not len(scan):
            return None
        self._scans.append(evidence(scan, self._scans[-1] if self._scans else None))
        self._counters.append(scan.meas_counter)
        whole = len(self._scans)
        return inputs(self._scans, whole, min(self._recent, whole))

    def say(self, answer: Estimate) -> None:
        """Remember what was answered to the window as it is now."""
        self._said.append(answer)

    @property
    def said_before(self) -> Estimate | None:
        """What was answered before the ``recent`` newest scans; None: they are the first."""
        return self._said[0] if len(self._said) == self._recent else None

    @property
    def in_doubt(self) -> bool:
        """Whether the newest scans contradicted those before them last time."""
        return self._contradictions > 0

    def contradicted(self, now: bool) -> bool:
        """Take in whether the newest scans contradict those before; tell whether often enough."""
        self._contradictions = self._contradictions + 1 if now else 0
        return self._contradictions >= CONTRADICTIONS

    def restart(self) -> None:
        """Forget all but the ``recent`` newest scans, and what was answered."""
        self._forget_all_but(self._recent)

    def _forget_all_but(self, newest: int) -> None:
        while len(self._scans) > newest:
            self._scans.popleft()
            self._counters.popleft()
        self._said.clear()
        self._contradictions = 0

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
