"""When a recorded message is due."""

from __future__ import annotations

from threading import Event
from time import monotonic


class Pace:
    """Counts from the first message on; ``speed`` (times real time) None never waits."""

    def __init__(self, speed: float | None) -> None:
        self._speed = speed
        self._first_stamp_ns: int | None = None
        self._start_s = 0.0

    def since_start_ns(self, stamp_ns: int) -> int:
        """Return how far a stamp is after the first one, nanoseconds."""
        if self._first_stamp_ns is None:
            self._first_stamp_ns = stamp_ns
            self._start_s = monotonic()
        return stamp_ns - self._first_stamp_ns

    def stopped_before(self, t_ns: int, stop: Event) -> bool:
        """Wait until a message is due; return True if the run was stopped before that."""
        if self._speed is None:
            return stop.is_set()
        due_s = self._start_s + t_ns * 1e-9 / self._speed - monotonic()
        return stop.wait(due_s) if due_s > 0 else stop.is_set()
