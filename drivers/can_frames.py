"""Raw CAN frames in bulk, as a structure of arrays: what logs, buses and the simulation yield."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntFlag

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
