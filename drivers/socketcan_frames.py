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

_REMOTE, _TRANSMITTED = int(FrameFlag.REMOTE), int(FrameFlag.TRANSMITTED)
_ID_MASK, _FLAG_BITS_SHIFT = np.uint32(ID_MASK), np.uint32(29)
_ID_FLAGS = np.array(
    [
        FrameFlag.ERROR
        if bits & 1
        else FrameFlag.REMOTE * (bits >> 1 & 1) | FrameFlag.EXTENDED * (bits >> 2)
        for bits in range(8)
    ],
    np.uint8,
)
"""Our flags by the three bits above an identifier: extended, remote, error."""
_FD_FLAGS = np.array(
    [
        FrameFlag.FD
        | FrameFlag.BIT_RATE_SWITCH * (bits & _BIT_RATE_SWITCH)
        | FrameFlag.ERROR_STATE * (bits & _ERROR_STATE > 0)
        for bits in range(4)
    ],
    np.uint8,
)
"""Our flags by the two flag bits of a CAN FD frame."""

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
    identifier = frame["id"]
    flags = _ID_FLAGS.take(identifier >> _FLAG_BITS_SHIFT)
    from_here = (message_flags & socket.MSG_DONTROUTE) != 0
    if from_here.any():
        flags[from_here] |= _TRANSMITTED
    width = 8
    is_fd = sizes > CLASSIC_BYTES
    if is_fd.any():
        width = 64
        flags[is_fd] |= _FD_FLAGS.take(frame["flags"][is_fd] & 3)
    length = np.minimum(frame["length"], np.uint8(width))
    data = frame["data"][:, :width].copy()
    if (length < width).any() or flags.any():
        written = np.where(flags & _REMOTE, 0, length)
        data *= np.arange(width) < written[:, None]
    return CanFrames(
        stamp_ns=stamp_ns,
        can_id=identifier & _ID_MASK,
        length=length,
        data=data,
        flags=flags,
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
