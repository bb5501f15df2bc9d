"""CAN frames with the time at which each is to be sent, and the box in which they wait for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.can_frames import CanFrames

Index = slice | NDArray[Any]

_ARRAYS = ("stamp_ns", "can_id", "length", "data", "flags", "channel")


def take(frames: CanFrames, index: Index) -> CanFrames:
    """Return the frames that ``index`` chooses, in its order."""
    return replace(frames, **{name: getattr(frames, name)[index] for name in _ARRAYS})


def join(batches: Sequence[CanFrames]) -> CanFrames:
    """Return the frames of several batches (at least one) of one bus, one after the other."""
    if len(batches) == 1:
        return batches[0]
    width = max(batch.data.shape[1] for batch in batches)
    arrays = {
        name: np.concatenate([getattr(batch, name) for batch in batches])
        for name in _ARRAYS
        if name != "data"
    }
    data = [np.pad(batch.data, ((0, 0), (0, width - batch.data.shape[1]))) for batch in batches]
    return replace(batches[-1], **arrays, data=np.concatenate(data))


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

    def __getitem__(self, index: Index) -> TimedFrames:
        return TimedFrames(take(self.frames, index), self.due_ns[index])


class Outbox:
    """Frames that wait until they are due; those due together leave in the order they came."""

    def __init__(self) -> None:
        self._waiting: list[TimedFrames] = []

    def put(self, timed: TimedFrames) -> None:
        """Add frames."""
        if len(timed):
            self._waiting.append(timed)

    def take(self, now_ns: int) -> CanFrames | None:
        """Take out what is due, in order of its due times; None where nothing is."""
        due: list[TimedFrames] = []
        later: list[TimedFrames] = []
        for timed in self._waiting:
            count = int(np.searchsorted(timed.due_ns, now_ns, side="right"))
            if count:
                due.append(timed[:count] if count < len(timed) else timed)
            if count < len(timed):
                later.append(timed[count:])
        self._waiting = later
        if not due:
            return None
        if len(due) == 1:
            return due[0].frames
        times = np.concatenate([timed.due_ns for timed in due])
        frames = join([timed.frames for timed in due])
        if (times[1:] >= times[:-1]).all():
            return frames
        return take(frames, np.argsort(times, kind="stable"))

    @property
    def next_due_ns(self) -> int | None:
        """When the next frame is due; None where none waits."""
        return min((int(timed.due_ns[0]) for timed in self._waiting), default=None)
