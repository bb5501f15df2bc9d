"""The pace of a live camera, and from it the frames that are missing between two stamps."""

from __future__ import annotations

from collections import deque

WINDOW = 16
SLOW = 1.2


class FramePace:
    """Counts missing frames by the interval between stamps.

    The expected interval is the negotiated one. A camera that runs slower by more than a fifth, as
    many do in the dark, is judged by its own pace: the lower octile of its latest sixteen
    intervals, which some frames in a row settle even while half of them are lost. Until then it
    seems to lose frames.

    Parameters
    ----------
    nominal_ns:
        The negotiated interval, nanoseconds.
    """

    def __init__(self, nominal_ns: int) -> None:
        self.nominal_ns = nominal_ns
        self._intervals: deque[int] = deque(maxlen=WINDOW)
        self._last_ns: int | None = None

    @property
    def interval_ns(self) -> int:
        """The expected interval, nanoseconds."""
        if len(self._intervals) < 4:
            return self.nominal_ns
        own = sorted(self._intervals)[len(self._intervals) // 8]
        return own if own > SLOW * self.nominal_ns else self.nominal_ns

    def missing_before(self, stamp_ns: int) -> int:
        """Return how many frames are missing between the stamp before and this one."""
        last_ns, self._last_ns = self._last_ns, stamp_ns
        if last_ns is None or stamp_ns <= last_ns:
            return 0
        missing = round((stamp_ns - last_ns) / self.interval_ns) - 1
        self._intervals.append(stamp_ns - last_ns)
        return max(0, missing)
