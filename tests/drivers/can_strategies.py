"""CAN frames as hypothesis draws them, and as rows that a test can compare."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from hypothesis import strategies as st

from drivers.can_frames import CanFrames, FrameFlag

FD_LENGTHS = [*range(9), 12, 16, 20, 24, 32, 48, 64]


class Row(NamedTuple):
    stamp_ns: int
    can_id: int
    length: int
    data: bytes
    flags: int
    channel: str


def rows_of(batches: Iterable[CanFrames]) -> list[Row]:
    return [
        Row(
            int(batch.stamp_ns[k]),
            int(batch.can_id[k]),
            int(batch.length[k]),
            batch.data[k].tobytes().rstrip(b"\0"),
            int(batch.flags[k]),
            batch.channels[batch.channel[k]],
        )
        for batch in batches
        for k in range(len(batch))
    ]


def frames_of(rows: list[Row], **more: Any) -> CanFrames:
    channels = tuple(dict.fromkeys(row.channel for row in rows))
    width = 64 if any(row.flags & FrameFlag.FD for row in rows) else 8
    return CanFrames(
        stamp_ns=np.array([row.stamp_ns for row in rows], np.int64),
        can_id=np.array([row.can_id for row in rows], np.uint32),
        length=np.array([row.length for row in rows], np.uint8),
        data=np.frombuffer(
            b"".join(row.data.ljust(width, b"\0") for row in rows), np.uint8
        ).reshape(-1, width),
        flags=np.array([row.flags for row in rows], np.uint8),
        channel=np.array([channels.index(row.channel) for row in rows], np.uint8),
        channels=channels,
        **more,
    )


@st.composite
def _row(draw: st.DrawFn, stamps: st.SearchStrategy[int], channels: st.SearchStrategy[str]) -> Row:
    kind = draw(st.sampled_from(["data", "remote", "error", "fd"]))
    flags = draw(st.sampled_from([0, FrameFlag.TRANSMITTED]))
    largest_id = 0x1FFFFFFF
    if kind == "error":
        flags |= FrameFlag.ERROR
    elif draw(st.booleans()):
        flags |= FrameFlag.EXTENDED
    else:
        largest_id = 0x7FF
    length = draw(st.integers(0, 8))
    if kind == "fd":
        length = draw(st.sampled_from(FD_LENGTHS))
        flags |= FrameFlag.FD
        flags |= draw(st.sampled_from([0, FrameFlag.BIT_RATE_SWITCH]))
        flags |= draw(st.sampled_from([0, FrameFlag.ERROR_STATE]))
    if kind == "remote":
        flags |= FrameFlag.REMOTE
        data = b""
    else:
        data = draw(st.binary(min_size=length, max_size=length)).rstrip(b"\0")
    can_id = draw(st.integers(0, largest_id))
    return Row(draw(stamps), can_id, length, data, int(flags), draw(channels))


CHANNELS = st.sampled_from(["can0", "can1", "vcan10", "slcan0"])
STAMPS = st.integers(0, 2**63 - 1)


def rows(
    stamps: st.SearchStrategy[int] = STAMPS,
    channels: st.SearchStrategy[str] = CHANNELS,
    **size: int,
) -> st.SearchStrategy[list[Row]]:
    return st.lists(_row(stamps, channels), **size)
