"""What CAN error frames say of the bus (linux/can/error.h)."""

from __future__ import annotations

from typing import Literal

import numpy as np

from drivers.can_frames import CanFrames, FrameFlag

BusState = Literal["error active", "error warning", "error passive", "bus-off"]

_CONTROLLER = 0x004
_BUS_OFF = 0x040
_RESTARTED = 0x100
_WARNING = 0x04 | 0x08
_PASSIVE = 0x10 | 0x20


def bus_states(frames: CanFrames) -> list[BusState]:
    """Return the controller's states that the error frames in a batch report, in their order.

    Error frames that report something else (a lost arbitration, a protocol violation) are left
    out. The controller's state is in the frame's second data byte where the class says so.
    """
    errors = np.flatnonzero(frames.flags & FrameFlag.ERROR)
    pairs = ((int(frames.can_id[at]), int(frames.data[at, 1])) for at in errors)
    states = (_state(error_class, controller) for error_class, controller in pairs)
    return [state for state in states if state is not None]


def _state(error_class: int, controller: int) -> BusState | None:
    if error_class & _BUS_OFF:
        return "bus-off"
    if error_class & _RESTARTED:
        return "error active"
    if not error_class & _CONTROLLER:
        return None
    if controller & _PASSIVE:
        return "error passive"
    return "error warning" if controller & _WARNING else "error active"
