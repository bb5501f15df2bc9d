"""CAN logs as the gateway's two sides, and the clock by which it runs from one to the other."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from dbc.errors import LogError
from drivers.can_frames import NO_FRAMES, CanFrames
from drivers.can_log import CANDUMP_SUFFIXES
from drivers.candump_writer import CandumpWriter
from node.gateway_scan import LONGEST_SCAN_NS
from node.player import Recording


def is_candump(target: str) -> bool:
    """Tell by its suffix whether a gateway's output is a candump log."""
    path = Path(target)
    suffix = Path(path.stem).suffix if path.suffix == ".gz" else path.suffix
    return suffix.lower() in CANDUMP_SUFFIXES


class Clock(Protocol):
    """What a gateway's loop asks for the time."""

    def now_ns(self) -> int:
        """Return the time of a clock that never steps, ns."""

    def stamp_ns(self) -> int:
        """Return the time that a stamp would say now, ns."""

    def sleep(self, seconds: float) -> None:
        """Let time pass."""


class SystemClock:
    """The computer's own."""

    now_ns = staticmethod(time.monotonic_ns)
    stamp_ns = staticmethod(time.time_ns)
    sleep = staticmethod(time.sleep)


class LogClock:
    """The time in a log, which passes as fast as the gateway can: nobody waits.

    Parameters
    ----------
    begin_ns:
        The stamp at which it begins.
    """

    def __init__(self, begin_ns: int) -> None:
        self._begin_ns = begin_ns
        self._passed_ns = 0

    def now_ns(self) -> int:
        """See ``Clock``."""
        return self._passed_ns

    def stamp_ns(self) -> int:
        """See ``Clock``."""
        return self._begin_ns + self._passed_ns

    def sleep(self, seconds: float) -> None:
        """See ``Clock``."""
        self._passed_ns += round(seconds * 1e9)


class LogSource:
    """The frames of a log, each when it is due; it reads as a bus does.

    Parameters
    ----------
    path:
        A CAN log of any kind.
    fast:
        As fast as possible instead of with the original timing.

    Attributes
    ----------
    clock:
        By which they are due.
    ended:
        Whether the last frame was read, and two cycles have passed since.

    Raises
    ------
    LogError
        If it is no log.
    """

    dropped = 0
    downs = 0

    def __init__(self, path: str, *, fast: bool) -> None:
        self.ended = False
        recording = Recording([Path(path)])
        _, first = next(recording.lap())  # what is no log is told before anything is open
        self.clock: Clock = LogClock(int(first.stamp_ns[0])) if fast else SystemClock()
        self._batches = recording.lap()
        self._frames = NO_FRAMES
        self._due_ns = NO_FRAMES.stamp_ns
        self._last_ns = 0
        self._started_ns: int | None = None
        self._first_stamp_ns = 0

    def read(self, timeout_s: float) -> CanFrames | None:
        """Return the frames that are due, waiting for one; None where none was."""
        clock = self.clock
        if self._started_ns is None:
            self._started_ns, self._first_stamp_ns = clock.now_ns(), clock.stamp_ns()
        due_in_ns = self._started_ns + self._next_due_ns() - clock.now_ns()
        clock.sleep(timeout_s if self.ended else min(max(due_in_ns * 1e-9, 0.0), timeout_s))
        passed_ns = clock.now_ns() - self._started_ns
        count = int(np.searchsorted(self._due_ns, passed_ns, side="right"))
        if not count:
            self.ended = not len(self._due_ns) and passed_ns >= self._next_due_ns()
            return None
        due_ns, frames = self._due_ns[:count], self._frames.select(slice(0, count))
        self._due_ns, self._frames = self._due_ns[count:], self._frames.select(slice(count, None))
        self._last_ns = int(due_ns[-1])
        return replace(frames, stamp_ns=self._first_stamp_ns + due_ns)

    def _next_due_ns(self) -> int:
        """Return when the next frame is due since the start, or when it is too late for any."""
        if not len(self._due_ns):
            self._due_ns, self._frames = next(self._batches, (self._due_ns, self._frames))
        return int(self._due_ns[0]) if len(self._due_ns) else self._last_ns + LONGEST_SCAN_NS

    def close(self) -> None:
        """Nothing stays open between reads."""


class LogTarget:
    """A candump log that frames are sent to; it appears under its name when it is closed.

    Parameters
    ----------
    path:
        Where it is to be; an older file there is replaced.
    clock:
        Tells when a frame is sent.

    Raises
    ------
    LogError
        If it cannot be made.
    """

    unsent = 0
    downs = 0

    def __init__(self, path: str, clock: Clock) -> None:
        self._clock = clock
        self._path = Path(path)
        self._unfinished = self._path.with_name(f".part-{self._path.name}")
        try:
            self._writer = CandumpWriter(self._unfinished)
        except LogError as error:
            raise LogError(path, error.what, error.remedy) from None

    def send(self, frames: CanFrames) -> bool:
        """Append frames with the time at which they are sent, to the microsecond."""
        stamp_ns = np.full(len(frames), self._clock.stamp_ns() // 1000 * 1000)
        self._writer.write(replace(frames, stamp_ns=stamp_ns))
        return True

    def close(self) -> None:
        """Finish the log; without a frame there is none."""
        self._writer.close()
        if self._writer.count:
            self._unfinished.replace(self._path)
        else:
            self._unfinished.unlink(missing_ok=True)
