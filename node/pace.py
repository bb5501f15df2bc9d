"""When a recorded message is due, and what time it is in a run whose clocks may be set."""

from __future__ import annotations

from threading import Event
from time import monotonic

CLOCK_STEP_NS = 10**9
"""A stamp that far before the newest is of a clock that was set back, not of a late message."""
_LEAP_NS = 60 * 10**9
"""A live stamp that far ahead of the time that has passed is of a clock that was set forward."""


class Pace:
    """Counts from the first message on.

    Parameters
    ----------
    speed:
        Times real time; None never waits.
    live:
        Whether the messages are of now, so that a clock set forward is told from a silence.
    """

    def __init__(self, speed: float | None, *, live: bool = False) -> None:
        self._speed = speed
        self._live = live
        self._first_stamp_ns: int | None = None
        self._newest_ns = 0
        self._newest_s = 0.0
        self._start_s = 0.0

    def since_start_ns(self, stamp_ns: int) -> int:
        """Return how far a stamp is after the first one, nanoseconds.

        Where the clock was set, time goes on from the newest stamp before.
        """
        now_s = monotonic()
        if self._first_stamp_ns is None:
            self._first_stamp_ns, self._start_s = stamp_ns, now_s
        elif self._was_set(stamp_ns, now_s):
            self._first_stamp_ns += stamp_ns - self._newest_ns
        self._newest_ns, self._newest_s = stamp_ns, now_s
        return stamp_ns - self._first_stamp_ns

    def _was_set(self, stamp_ns: int, now_s: float) -> bool:
        elapsed_ns = stamp_ns - self._newest_ns
        leap = self._live and elapsed_ns > (now_s - self._newest_s) * 1e9 + _LEAP_NS
        return leap or elapsed_ns < -CLOCK_STEP_NS

    def stopped_before(self, t_ns: int, stop: Event) -> bool:
        """Wait until a message is due; return True if the run was stopped before that."""
        if self._speed is None:
            return stop.is_set()
        due_s = self._start_s + t_ns * 1e-9 / self._speed - monotonic()
        return stop.wait(due_s) if due_s > 0 else stop.is_set()
