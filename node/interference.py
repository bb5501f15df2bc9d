"""The radar's own word on interference: a bit of its state (0x201) on the bus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from drivers.ars408_layout import CAN_ID, ID_SHIFT, PAYLOAD_BYTES, Kind
from drivers.can_frames import CanFrames, FrameFlag
from drivers.encode import encode_state
from drivers.scan import RadarState

_NOT_PLAIN = int(FrameFlag.EXTENDED | FrameFlag.REMOTE | FrameFlag.ERROR | FrameFlag.FD)


def states_of(frames: CanFrames, sensor_id: int) -> NDArray[np.intp]:
    """Return the rows of a radar's state frames, whole ones only."""
    own = frames.can_id == CAN_ID[Kind.RADAR_STATE] + ID_SHIFT * sensor_id
    own &= (frames.flags & _NOT_PLAIN == 0) & (frames.length >= PAYLOAD_BYTES)
    return np.flatnonzero(own)


def with_interference_told(frames: CanFrames, rows: Sequence[int]) -> CanFrames:
    """Return the frames with the interference bit set in the states of these rows."""
    if not len(rows):
        return frames
    data = frames.data.copy()
    data[rows, :PAYLOAD_BYTES] |= _told()
    return replace(frames, data=data)


@cache
def _told() -> NDArray[np.uint8]:
    """Return a state's payload, (8,), in which that bit alone is set."""
    frames = encode_state(RadarState("", 0, 0, {"RadarState_Interference": 1.0}))
    return np.asarray(frames.data[0, :PAYLOAD_BYTES])
