"""Several streams of CAN frames merged into one by time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.can_frames import NO_FRAMES, CanFrames, concatenate


def merge_by_time(streams: Sequence[Iterator[CanFrames]]) -> Iterator[CanFrames]:
    """Merge streams by their stamps in constant memory.

    Each stream keeps its own order, even where its stamps run backwards; frames of different
    streams with the same stamp come in either order.
    """
    if len(streams) == 1:
        yield from streams[0]
        return
    heads = [head for head in map(_Head, streams) if head.fill()]
    while heads:
        until_ns = min(int(head.order_ns[-1]) for head in heads)
        taken = [head.take(until_ns) for head in heads]
        order = np.argsort(np.concatenate([order_ns for _, order_ns in taken]), kind="stable")
        yield concatenate([frames for frames, _ in taken]).select(order)
        heads = [head for head in heads if head.fill()]


class _Head:
    """What of a stream has been read and not yet taken."""

    def __init__(self, stream: Iterator[CanFrames]) -> None:
        self._stream = stream
        self._frames = NO_FRAMES
        self._latest_ns = np.iinfo(np.int64).min
        self.order_ns: NDArray[np.int64] = NO_FRAMES.stamp_ns

    def fill(self) -> bool:
        """Read on if nothing is left; False at the stream's end."""
        while not len(self._frames):
            frames = next(self._stream, None)
            if frames is None:
                return False
            self._frames = frames
            self.order_ns = np.maximum(np.maximum.accumulate(frames.stamp_ns), self._latest_ns)
        return True

    def take(self, until_ns: int) -> tuple[CanFrames, NDArray[np.int64]]:
        """Return the frames up to a time, and the times that order them."""
        count = int(np.searchsorted(self.order_ns, until_ns, side="right"))
        taken = self._frames.select(slice(count)), self.order_ns[:count]
        self._frames = self._frames.select(slice(count, None))
        self.order_ns = self.order_ns[count:]
        self._latest_ns = max(self._latest_ns, until_ns)
        return taken
