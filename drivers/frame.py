"""A camera frame, and how the stamp of a message was taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

StampSource = Literal["hardware", "kernel", "device", "file", "simulated", "read"]
"""Who took a stamp: the CAN controller, the kernel, the camera, the recording, the simulated
world, or (last resort) the reader when it got the message."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One image of one camera.

    Attributes
    ----------
    image:
        (height, width, 3) uint8, BGR.
    sensor:
        The camera's name in the scene.
    sequence:
        Count of frames captured by this source, from 0; a gap is a lost frame.
    stamp_ns:
        Moment of capture, integer nanoseconds.
    stamp_source:
        How the stamp was taken.
    dropped:
        Frames lost before this one since the source was opened.
    injected:
        ``{kind: level in %}`` that was injected before the source gave it, where it says so.
    drawn:
        Of these the drawn parameters by kind, where the source knows them.
    """

    image: NDArray[np.uint8]
    sensor: str
    sequence: int
    stamp_ns: int
    stamp_source: StampSource
    dropped: int = 0
    injected: Mapping[str, float] | None = None
    drawn: Mapping[str, Any] | None = None
