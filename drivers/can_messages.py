"""python-can's ``Message`` to ``CanFrames`` and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from can import Message
from numpy.typing import NDArray

from drivers.can_frames import CanFrames, FrameFlag
from drivers.frame import StampSource


def from_messages(
    messages: Sequence[Message],
    channels: Sequence[str],
    channel: NDArray[np.uint8] | None = None,
    stamp_source: StampSource = "file",
) -> CanFrames:
    """Gather messages in bulk.

    python-can keeps stamps as float seconds, which is exact to the microsecond; so are these.

    Parameters
    ----------
    messages:
        N messages.
    channels, channel:
        Names of the interfaces and, for each message, which it came from ((N,) uint8); by default
        all came from the first.
    stamp_source:
        How the stamps were taken.
    """
    count = len(messages)
    data = np.zeros((count, 64 if any(message.is_fd for message in messages) else 8), np.uint8)
    for row, message in zip(data, messages, strict=True):
        row[: len(message.data)] = message.data
    return CanFrames(
        stamp_ns=np.array(
            [round(message.timestamp * 1e6) * 1000 for message in messages], np.int64
        ),
        can_id=np.array([message.arbitration_id & 0x1FFFFFFF for message in messages], np.uint32),
        length=np.array([message.dlc for message in messages], np.uint8),
        data=data,
        flags=np.array([_flags(message) for message in messages], np.uint8),
        channel=np.zeros(count, np.uint8) if channel is None else channel,
        channels=channels,
        stamp_source=stamp_source,
    )


def to_messages(frames: CanFrames) -> Iterator[Message]:
    """Yield one message a frame, with its interface's name as channel."""
    rows = zip(
        frames.stamp_ns.tolist(),
        frames.can_id.tolist(),
        frames.length.tolist(),
        frames.data,
        frames.flags.tolist(),
        frames.channel.tolist(),
        strict=True,
    )
    for stamp_ns, can_id, length, data, flags, channel in rows:
        yield Message(
            timestamp=stamp_ns / 1e9,
            arbitration_id=can_id,
            is_extended_id=bool(flags & FrameFlag.EXTENDED),
            is_remote_frame=bool(flags & FrameFlag.REMOTE),
            is_error_frame=bool(flags & FrameFlag.ERROR),
            is_fd=bool(flags & FrameFlag.FD),
            bitrate_switch=bool(flags & FrameFlag.BIT_RATE_SWITCH),
            error_state_indicator=bool(flags & FrameFlag.ERROR_STATE),
            is_rx=not flags & FrameFlag.TRANSMITTED,
            channel=frames.channels[channel],
            dlc=length,
            data=bytearray(data[:length]),
        )


def _flags(message: Message) -> int:
    flags = FrameFlag.REMOTE * message.is_remote_frame
    flags |= FrameFlag.TRANSMITTED * (not message.is_rx)
    if message.is_error_frame:
        return flags | FrameFlag.ERROR
    flags |= FrameFlag.EXTENDED * message.is_extended_id
    flags |= FrameFlag.FD * message.is_fd
    flags |= FrameFlag.BIT_RATE_SWITCH * message.bitrate_switch
    return flags | FrameFlag.ERROR_STATE * message.error_state_indicator
