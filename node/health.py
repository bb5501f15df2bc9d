"""Whether a live sensor speaks: never seen, ok, stale or lost. Silence is a fault."""

from __future__ import annotations

from dataclasses import dataclass
from threading import Lock
from time import time_ns
from typing import Literal

from node.pace import CLOCK_STEP_NS

State = Literal["never_seen", "ok", "stale", "lost"]

SILENT_CYCLES = 3
"""A sensor is stale after so many of its cycles without a message."""
NEVER_SEEN_S = 1.0
"""When a sensor that has sent nothing yet is reported as never seen."""
SHORTEST_S = 0.15
"""No silence shorter than this is a fault: a scheduler's hiccup lasts that long."""


@dataclass(frozen=True, slots=True)
class SensorEvent:
    """Something that happened to a sensor.

    Attributes
    ----------
    sensor:
        Its name in the scene.
    stamp_ns:
        When it was noticed, wall time, integer nanoseconds.
    state:
        The sensor's state from then on; ``"lost"`` where its bus or device is down or gone.
    detail:
        One line for a person.
    """

    sensor: str
    stamp_ns: int
    state: State
    detail: str


class Health:
    """State of one sensor, from when its messages come. Times are of the monotonic clock, s.

    The cycle is learned as a running mean of the intervals between the stamps of messages.
    """

    def __init__(self, sensor: str, now_s: float) -> None:
        self.state: State = "never_seen"
        self._sensor = sensor
        self._start_s = now_s
        self._last_s: float | None = None
        self._stamp_ns: int | None = None
        self._cycle_s: float | None = None
        self._told = False
        self._lock = Lock()

    def seen(self, now_s: float, stamp_ns: int) -> SensorEvent | None:
        """Take in a message; return an event where it is news.

        That is where it ends a silence, noticed before or not, or shows a clock that was set back.

        Parameters
        ----------
        stamp_ns:
            When the sensor took it: that teaches the cycle, whenever it is read.
        """
        with self._lock:
            before = self.state
            silence_s = now_s - (self._start_s if self._last_s is None else self._last_s)
            interval_ns = 0 if self._stamp_ns is None else stamp_ns - self._stamp_ns
            if self._stamp_ns is not None:
                self._learn(interval_ns * 1e-9)
            self.state, self._last_s, self._stamp_ns = "ok", now_s, stamp_ns
        if before == "never_seen":
            return self._event(f"first message after {silence_s:.2f} s")
        if interval_ns < -CLOCK_STEP_NS:
            return self._event(f"its clock was set back by {-interval_ns * 1e-9:.2f} s")
        if before == "ok" and not self._is_too_long(silence_s):
            return None
        return self._event(f"back after {silence_s:.2f} s")

    def _learn(self, interval_s: float) -> None:
        """Take in the time from one message to the next; a gap counts as three cycles at most."""
        if self._cycle_s is None:
            self._cycle_s = interval_s if interval_s > 0 else None
        else:
            interval_s = min(max(interval_s, 0.0), SILENT_CYCLES * self._cycle_s)
            self._cycle_s += 0.1 * (interval_s - self._cycle_s)

    def lost(self, detail: str) -> SensorEvent | None:
        """Take in that the bus or device is down; return an event where that is news."""
        with self._lock:
            if self.state == "lost":
                return None
            self.state = "lost"
        return self._event(detail)

    def check(self, now_s: float) -> SensorEvent | None:
        """Look whether the silence has lasted too long; return an event where that is news."""
        with self._lock:
            if self.state == "never_seen":
                if self._told or now_s - self._start_s < NEVER_SEEN_S:
                    return None
                self._told = True
                return self._event("nothing came since the start")
            if self.state != "ok" or self._last_s is None or self._cycle_s is None:
                return None
            silence_s = now_s - self._last_s
            if not self._is_too_long(silence_s):
                return None
            self.state = "stale"
            cycle = f"its cycle is {self._cycle_s * 1e3:.0f} ms"
        return self._event(f"silent for {silence_s:.2f} s, {cycle}")

    def _is_too_long(self, silence_s: float) -> bool:
        cycle_s = self._cycle_s
        return cycle_s is not None and silence_s >= max(SILENT_CYCLES * cycle_s, SHORTEST_S)

    def _event(self, detail: str) -> SensorEvent:
        return SensorEvent(self._sensor, time_ns(), self.state, detail)
