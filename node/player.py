"""Recorded CAN frames onto a bus, with their original timing."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Event

import numpy as np
from numpy.typing import NDArray

from dbc.errors import LogError, SceneError
from drivers.can_bus import CanBus
from drivers.can_frames import CanFrames, FrameFlag
from drivers.can_log import read_log
from drivers.can_merge import merge_by_time

_CHUNK_BYTES = 1 << 15
"""Of a log read at once: some 700 frames, well under a millisecond."""
_LATEST_US = 1_000_000
_SHORTEST_LAP_NS = 1_000_000


@dataclass(frozen=True, slots=True)
class Recording:
    """One or more CAN logs, merged by time.

    Attributes
    ----------
    paths:
        The logs.
    ids:
        Identifiers to play; all by default.
    start_s, end_s:
        The part to play, seconds since the first frame of all.
    """

    paths: Sequence[Path]
    ids: Collection[int] | None = None
    start_s: float = 0.0
    end_s: float | None = None

    @property
    def length_s(self) -> float | None:
        """Seconds of the part to play; None where it lasts to the end of the logs."""
        return None if self.end_s is None else self.end_s - self.start_s

    def __post_init__(self) -> None:
        """Refuse a part that cannot be.

        Raises
        ------
        SceneError
            Naming the flag.
        """
        if self.start_s < 0:
            raise SceneError("--start", "is negative", "give seconds since the log's first frame")
        if self.end_s is not None and self.end_s <= self.start_s:
            raise SceneError("--end", "is not after --start", "give a later second")

    def lap(self) -> Iterator[tuple[NDArray[np.int64], CanFrames]]:
        """Yield the frames once from start to end, and when each is due.

        Yields
        ------
        due_ns
            (n,) int64, nanoseconds since the start of the part; never falling.
        frames
            n frames, n at least 1.

        Raises
        ------
        LogError
            If a log is bad, after the frames before that; or if no frame is left to play.
        """
        count = 0
        for due_ns, frames in self._window():
            wanted = np.ones(len(frames), np.bool_)
            if self.ids is not None:
                wanted = np.isin(frames.can_id, list(self.ids))
            if wanted.any():
                count += int(wanted.sum())
                yield due_ns[wanted], frames.select(wanted)
        if not count:
            where = ", ".join(map(str, self.paths))
            raise LogError(where, "no frame is left to play", "widen --start, --end or --id")

    def _window(self) -> Iterator[tuple[NDArray[np.int64], CanFrames]]:
        origin_ns: int | None = None
        latest_ns = np.iinfo(np.int64).min
        end_ns = None if self.length_s is None else round(self.length_s * 1e9)
        for frames in merge_by_time([read_log(path, _CHUNK_BYTES) for path in self.paths]):
            if origin_ns is None:
                origin_ns = int(frames.stamp_ns[0]) + round(self.start_s * 1e9)
            due_ns = np.maximum(np.maximum.accumulate(frames.stamp_ns - origin_ns), latest_ns)
            latest_ns = int(due_ns[-1])
            first = np.searchsorted(due_ns, 0)
            last = len(due_ns) if end_ns is None else np.searchsorted(due_ns, end_ns)
            if first < last:
                yield due_ns[first:last], frames.select(slice(first, last))
            if last < len(due_ns):
                return


class Lateness:
    """How late frames were sent, in whole microseconds, in constant memory."""

    def __init__(self) -> None:
        self._counts = np.zeros(_LATEST_US + 1, np.uint32)
        self.max_us = 0

    def add(self, late_ns: NDArray[np.int64]) -> None:
        """Count n delays of 0 or more."""
        late_us = late_ns // 1000
        self.max_us = max(self.max_us, int(late_us.max()))
        np.add.at(self._counts, np.minimum(late_us, _LATEST_US), 1)

    def percentile_us(self, percent: float) -> int:
        """Return the delay that so many percent of the frames did not exceed, a second at most."""
        cumulated = np.cumsum(self._counts, dtype=np.int64)
        return int(np.searchsorted(cumulated, percent / 100 * cumulated[-1]))


class Player:
    """Sends a recording onto a bus when its frames are due.

    The schedule is absolute, so what one frame is late is not added to the next. Error frames are
    no messages that a computer could send: they are left out and counted.

    Parameters
    ----------
    recording:
        What to play.
    bus:
        Where to.
    speed:
        Factor on time: 2 plays twice as fast.
    loop:
        Begin again at the end, until stopped. The last frame of a lap is followed by the first of
        the next after the recording's mean spacing, or when the part is over where its end was
        given.
    clock_ns:
        A monotonic clock, nanoseconds.
    wait:
        Sleeps so many seconds; True where the player shall stop.

    Attributes
    ----------
    frames, laps, skipped:
        Frames sent, laps begun and error frames left out so far.
    played_s:
        Where in the recording the player is.
    at_lap:
        Called with the clock's time at which each lap begins, nanoseconds; may be set.
    """

    def __init__(
        self,
        recording: Recording,
        bus: CanBus,
        *,
        speed: float = 1.0,
        loop: bool = False,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        wait: Callable[[float], bool] | None = None,
    ) -> None:
        if not speed > 0:
            raise SceneError("--speed", "is not above 0", "give 1 for the original timing")
        self._recording = recording
        self._bus = bus
        self._speed = speed
        self._loop = loop
        self._clock_ns = clock_ns
        self._stop = Event()
        self._wait = wait or self._stop.wait
        self.at_lap: Callable[[int], None] = lambda start_ns: None
        self._lateness = Lateness()
        self.frames = self.laps = self.skipped = 0
        self.played_s = 0.0
        self._duration_ns = 0

    def stop(self) -> None:
        """End soon. Safe in a signal handler."""
        self._stop.set()

    def run(self) -> None:
        """Play to the end, or until stopped.

        Raises
        ------
        LogError
            If a log is bad, after the frames before that; or no frame is left to play.
        BusDown, DeviceError
            If the bus cannot take a frame.
        """
        began_ns = lap_ns = self._clock_ns()
        try:
            while not self._stop.is_set():
                self.laps += 1
                self.at_lap(lap_ns)
                lap_ns += round(self._play_lap(lap_ns) / self._speed)
                if not self._loop:
                    break
        finally:
            self._duration_ns = self._clock_ns() - began_ns

    def summary(self) -> dict[str, int | float]:
        """Return what was played and how late, as the command shows it."""
        return {
            "frames": self.frames,
            "laps": self.laps,
            "skipped": self.skipped,
            "retries": self._bus.retries,
            "duration_s": self._duration_ns / 1e9,
            "late_p99_us": self._lateness.percentile_us(99),
            "late_max_us": self._lateness.max_us,
        }

    def _play_lap(self, start_ns: int) -> int:
        """Play once from a time of the clock on; return how long the lap is as recorded, ns."""
        count = last_ns = 0
        for due_ns, frames in self._recording.lap():
            is_message = (frames.flags & FrameFlag.ERROR) == 0
            self.skipped += int((~is_message).sum())
            self._send_when_due(start_ns, due_ns[is_message], frames.select(is_message))
            if self._stop.is_set():
                break
            count += len(frames)
            last_ns = int(due_ns[-1])
        if self._recording.length_s is not None:
            return round(self._recording.length_s * 1e9)
        return max(_SHORTEST_LAP_NS, last_ns + last_ns // max(1, count - 1))

    def _send_when_due(self, start_ns: int, due_ns: NDArray[np.int64], frames: CanFrames) -> None:
        clock_ns = start_ns + (due_ns / self._speed).astype(np.int64)
        sent = 0
        while sent < len(frames) and not self._stop.is_set():
            now_ns = self._clock_ns()
            ready = int(np.searchsorted(clock_ns, now_ns, side="right"))
            if ready == sent:
                if self._wait((int(clock_ns[sent]) - now_ns) / 1e9):
                    self.stop()
                continue
            self._bus.send(frames.select(slice(sent, ready)))
            self._lateness.add(self._clock_ns() - clock_ns[sent:ready])
            self.frames += ready - sent
            self.played_s = int(due_ns[ready - 1]) / 1e9
            sent = ready
