"""``struct can_frame`` and ``struct canfd_frame`` of Linux to ``CanFrames`` and back."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drivers.can_frames import CanFrames, FrameFlag
from drivers.frame import StampSource

# linux/can.h
EXTENDED_BIT, REMOTE_BIT, ERROR_BIT, ID_MASK = 0x80000000, 0x40000000, 0x20000000, 0x1FFFFFFF
_BIT_RATE_SWITCH, _ERROR_STATE = 1, 2

CLASSIC_BYTES = 16
FRAME = np.dtype(
    [
        ("id", np.uint32),
        ("length", np.uint8),
        ("flags", np.uint8),
        ("reserved", np.uint8, 2),
        ("data", np.uint8, 64),
    ]
)
"""``struct canfd_frame``; ``struct can_frame`` is its first ``CLASSIC_BYTES``, without flags."""


def unpack_frames(
    datagrams: NDArray[np.uint8],
    sizes: NDArray[np.uint32],
    message_flags: NDArray[np.int32],
    stamp_ns: NDArray[np.int64],
    channel: str,
    stamp_source: StampSource,
    dropped: int,
) -> CanFrames:
    """Read n frames as a raw CAN socket gives them.

    Parameters
    ----------
    datagrams:
        (n, 72) uint8, contiguous; bytes beyond the size do not matter.
    sizes:
        (n,) bytes of each: ``CLASSIC_BYTES`` or 72.
    message_flags:
        (n,) ``MSG_`` bits; ``MSG_DONTROUTE`` marks a frame that this computer sent.
    stamp_ns, channel, stamp_source, dropped:
        As in ``CanFrames``.
    """
    frame = datagrams.view(FRAME)[:, 0]
    is_fd = sizes > CLASSIC_BYTES
    is_error = (frame["id"] & ERROR_BIT) != 0
    is_remote = (frame["id"] & REMOTE_BIT) != 0
    fd_flags = np.where(is_fd, frame["flags"], 0)
    flags = (
        FrameFlag.EXTENDED * (((frame["id"] & EXTENDED_BIT) != 0) & ~is_error)
        | FrameFlag.REMOTE * is_remote
        | FrameFlag.ERROR * is_error
        | FrameFlag.FD * is_fd
        | FrameFlag.BIT_RATE_SWITCH * ((fd_flags & _BIT_RATE_SWITCH) != 0)
        | FrameFlag.ERROR_STATE * ((fd_flags & _ERROR_STATE) != 0)
        | FrameFlag.TRANSMITTED * ((message_flags & socket.MSG_DONTROUTE) != 0)
    )
    width = 64 if is_fd.any() else 8
    length = np.minimum(frame["length"], width).astype(np.uint8)
    written = np.where(is_remote, 0, length)
    inside = np.arange(width) < written[:, None]
    return CanFrames(
        stamp_ns=stamp_ns,
        can_id=frame["id"] & np.uint32(ID_MASK),
        length=length,
        data=np.where(inside, frame["data"][:, :width], 0).astype(np.uint8),
        flags=flags.astype(np.uint8),
        channel=np.zeros(len(frame), np.uint8),
        channels=(channel,),
        stamp_source=stamp_source,
        dropped=dropped,
    )


def pack_frames(frames: CanFrames) -> Iterator[bytes]:
    """Yield the datagram of each frame: 16 bytes, or 72 of a CAN FD frame."""
    packed = np.zeros(len(frames), FRAME)
    packed["id"] = frames.can_id
    for flag, bit in (
        (FrameFlag.EXTENDED, EXTENDED_BIT),
        (FrameFlag.REMOTE, REMOTE_BIT),
        (FrameFlag.ERROR, ERROR_BIT),
    ):
        packed["id"] |= np.where(frames.flags & flag, bit, 0).astype(np.uint32)
    packed["length"] = frames.length
    switch = np.where(frames.flags & FrameFlag.BIT_RATE_SWITCH, _BIT_RATE_SWITCH, 0)
    packed["flags"] = switch | np.where(frames.flags & FrameFlag.ERROR_STATE, _ERROR_STATE, 0)
    packed["data"][:, : frames.data.shape[1]] = frames.data
    is_fd = (frames.flags & FrameFlag.FD) != 0
    for datagram, fd in zip(packed, is_fd.tolist(), strict=True):
        yield datagram.tobytes()[: None if fd else CLASSIC_BYTES]
