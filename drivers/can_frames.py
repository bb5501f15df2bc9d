"""Raw CAN frames in bulk, as a structure of arrays: what logs, buses and the simulation yield."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.frame import StampSource


class FrameFlag(IntFlag):
    """Bits of ``CanFrames.flags``."""

    EXTENDED = 1
    REMOTE = 2
    ERROR = 4
    FD = 8
    BIT_RATE_SWITCH = 16
    ERROR_STATE = 32
    TRANSMITTED = 64


@dataclass(frozen=True, slots=True, eq=False)
class CanFrames:
    """N CAN frames in order of reception.

    Attributes
    ----------
    stamp_ns:
        (N,) int64, nanoseconds.
    can_id:
        (N,) uint32, identifier without flag bits.
    length:
        (N,) uint8, payload bytes.
    data:
        (N, 8) uint8, or (N, 64) where a CAN FD frame is among them; zero beyond ``length``.
    flags:
        (N,) uint8 of ``FrameFlag`` bits.
    channel:
        (N,) uint8, index into ``channels``.
    channels:
        Interface names.
    stamp_source:
        How the stamps were taken.
    dropped:
        Frames dropped by the kernel since the bus was opened, where it tells.
    """

    stamp_ns: NDArray[np.int64]
    can_id: NDArray[np.uint32]
    length: NDArray[np.uint8]
    data: NDArray[np.uint8]
    flags: NDArray[np.uint8]
    channel: NDArray[np.uint8]
    channels: Sequence[str] = ("can0",)
    stamp_source: StampSource = "file"
    dropped: int = 0

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def select(self, rows: slice | NDArray[Any]) -> CanFrames:
        """Return the frames of a slice, an index array or a mask; a slice copies nothing."""
        return replace(
            self,
            stamp_ns=self.stamp_ns[rows],
            can_id=self.can_id[rows],
            length=self.length[rows],
            data=self.data[rows],
            flags=self.flags[rows],
            channel=self.channel[rows],
        )


NO_FRAMES = CanFrames(
    stamp_ns=np.zeros(0, np.int64),
    can_id=np.zeros(0, np.uint32),
    length=np.zeros(0, np.uint8),
    data=np.zeros((0, 8), np.uint8),
    flags=np.zeros(0, np.uint8),
    channel=np.zeros(0, np.uint8),
)


def concatenate(batches: Sequence[CanFrames]) -> CanFrames:
    """Put at least one batch one after another; stamps are as sure as those of the first."""
    if len(batches) == 1:
        return batches[0]
    channels = tuple(dict.fromkeys(name for batch in batches for name in batch.channels))
    width = max(batch.data.shape[1] for batch in batches)
    return CanFrames(
        stamp_ns=np.concatenate([batch.stamp_ns for batch in batches]),
        can_id=np.concatenate([batch.can_id for batch in batches]),
        length=np.concatenate([batch.length for batch in batches]),
        data=np.concatenate([_widened(batch.data, width) for batch in batches]),
        flags=np.concatenate([batch.flags for batch in batches]),
        channel=np.concatenate([_renumbered(batch, channels) for batch in batches]),
        channels=channels,
        stamp_source=batches[0].stamp_source,
        dropped=max(batch.dropped for batch in batches),
    )


def _widened(data: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    missing = width - data.shape[1]
    return np.pad(data, ((0, 0), (0, missing))) if missing else data


def _renumbered(batch: CanFrames, channels: tuple[str, ...]) -> NDArray[np.uint8]:
    if tuple(batch.channels) == channels[: len(batch.channels)]:
        return batch.channel
    return np.array([channels.index(name) for name in batch.channels], np.uint8)[batch.channel]
