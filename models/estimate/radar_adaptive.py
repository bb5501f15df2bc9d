"""No more effort than it takes: every second scan while a radar's level is certain and steady."""

from __future__ import annotations

from drivers.scan import RadarScan
from models.estimate.level import Estimate
from models.estimate.radar import RadarEstimator
from models.estimate.radar_window import ScanWindow

SURE = 0.9
"""Least probability of the most probable level and its neighbours of a certain estimate."""
STEADY_LEVELS = 1
"""Change of the most probable level, in steps of 10 points, up to which it is steady."""
SAME_COUNT = 0.1
"""Change of the number of clusters, as a share, up to which nothing seems to have happened."""
LONGEST_REST_S = 0.1
"""Longest time between scans up to which one may be left out, s: not where scans are rare."""


class AdaptiveRadar:
    """Estimates successive scans of one radar, for one thread.

    After two certain estimates of the same level, every second scan is left out, as long as the
    number of clusters stays the same and the newest scans do not contradict those before them.
    """

    def __init__(self, radar: RadarEstimator) -> None:
        self._radar = radar
        self._window = ScanWindow()
        self._steady = False
        self._rested = False
        self._sure_of: int | None = None
        self._clusters = 0
        self._stamp_ns = 0

    def estimate(self, scan: RadarScan) -> Estimate | None:
        """Return the estimate of the next scan, or None where it is left out.

        Raises
        ------
        InputError
            If the scan is in object mode.
        """
        since_s = (scan.stamp_ns - self._stamp_ns) * 1e-9
        self._stamp_ns = scan.stamp_ns
        alike = abs(len(scan) - self._clusters) <= SAME_COUNT * self._clusters
        calm = self._steady and alike and 0 < since_s <= LONGEST_REST_S
        self._rested = calm and not self._rested and scan.mode == "cluster"
        if self._rested:
            return None
        estimate = self._radar.estimate_next(self._window, scan)
        level = sure_level(estimate)
        self._steady = (
            alike
            and not self._window.in_doubt
            and level is not None
            and self._sure_of is not None
            and abs(level - self._sure_of) <= STEADY_LEVELS
        )
        self._sure_of, self._clusters = level, len(scan)
        return estimate


def sure_level(estimate: Estimate) -> int | None:
    """Return the index of the most probable level, or None where the estimate is not certain."""
    best = int(estimate.probabilities.argmax())
    near = estimate.probabilities[max(0, best - 1) : best + 2].sum()
    return best if near >= SURE else None
