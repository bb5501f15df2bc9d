"""CAN frames with the time at which each is to be sent, and the box in which they wait for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.can_frames import CanFrames, concatenate


@dataclass(frozen=True, slots=True, eq=False)
class TimedFrames:
    """CAN frames and when each is to be sent.

    Attributes
    ----------
    frames:
        N frames; their stamps stay those of reception.
    due_ns:
        (N,) int64, not decreasing, nanoseconds of the sender's clock.
    """

    frames: CanFrames
    due_ns: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.due_ns)

    def __getitem__(self, rows: slice | NDArray[Any]) -> TimedFrames:
        return TimedFrames(self.frames.select(rows), self.due_ns[rows])


class Outbox:
    """Frames that wait until they are due; those due at one time leave in the order they came."""

    def __init__(self) -> None:
        self._waiting: list[TimedFrames] = []

    def put(self, timed: TimedFrames) -> None:
        """Add frames."""
        if len(timed):
            self._waiting.append(timed)

    def take(self, now_ns: int) -> CanFrames | None:
        """Take out what is due, in order of due times; None where nothing is."""
        due: list[TimedFrames] = []
        later: list[TimedFrames] = []
        for timed in self._waiting:
            count = int(np.searchsorted(timed.due_ns, now_ns, side="right"))
            if count == 0:
                later.append(timed)
            elif count == len(timed):
                due.append(timed)
            else:
                due.append(timed[:count])
                later.append(timed[count:])
        self._waiting = later
        if not due:
            return None
        frames = concatenate([timed.frames for timed in due])
        if len(due) == 1:
            return frames
        return frames.select(np.argsort(np.concatenate([t.due_ns for t in due]), kind="stable"))

    @property
    def next_due_ns(self) -> int | None:
        """When the next frame is due; None where none waits."""
        return min((int(timed.due_ns[0]) for timed in self._waiting), default=None)
