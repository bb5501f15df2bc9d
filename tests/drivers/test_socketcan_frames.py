from __future__ import annotations

import socket

import numpy as np
from can_strategies import Row, frames_of, rows, rows_of
from hypothesis import given
from hypothesis import strategies as st

from drivers.can_frames import CanFrames, FrameFlag
from drivers.socketcan_frames import pack_frames, unpack_frames


def unpack(datagrams: list[bytes], rest: bytes = b"\0", message_flags: int = 0) -> CanFrames:
    padded = b"".join(datagram.ljust(72, rest) for datagram in datagrams)
    return unpack_frames(
        np.frombuffer(padded, np.uint8).reshape(-1, 72),
        np.array([len(datagram) for datagram in datagrams], np.uint32),
        np.full(len(datagrams), message_flags, np.int32),
        np.arange(len(datagrams)),
        channel="can0",
        stamp_source="kernel",
        dropped=3,
    )


def as_sent(drawn: list[Row]) -> list[Row]:
    """What a receiver sees of drawn frames: other stamps, its own channel, nothing of direction."""
    return [
        row._replace(stamp_ns=k, channel="can0", flags=row.flags & ~FrameFlag.TRANSMITTED)
        for k, row in enumerate(drawn)
    ]


@given(rows(), st.sampled_from([b"\0", b"\xff"]))
def test_frames_survive_the_kernels_form_whatever_lies_behind_them(
    drawn: list[Row], rest: bytes
) -> None:
    frames = unpack(list(pack_frames(frames_of(drawn))), rest)
    assert rows_of([frames]) == as_sent(drawn)
    assert frames.stamp_source == "kernel"
    assert frames.dropped == 3


def test_a_classic_and_an_fd_frame_as_the_kernel_writes_them() -> None:
    """linux/can.h: id with flag bits, length, flags, two reserved bytes, data."""
    frames = frames_of(
        [
            Row(0, 0x123, 2, b"\x11\x22", 0, "can0"),
            Row(0, 0x1ABCDEF, 1, b"\x33", FrameFlag.EXTENDED | FrameFlag.FD | 16, "can0"),
            Row(0, 0x123, 4, b"", FrameFlag.REMOTE, "can0"),
        ]
    )
    classic, fd, remote = pack_frames(frames)
    assert classic == bytes.fromhex("23010000 02000000 1122000000000000")
    assert fd == bytes.fromhex("EFCDAB81 01010000 33") + bytes(63)
    assert remote == bytes.fromhex("23010040 04000000 0000000000000000")


def test_a_frame_of_this_computer_is_marked_transmitted() -> None:
    datagram = next(pack_frames(frames_of([Row(0, 0x123, 0, b"", 0, "can0")])))
    (row,) = rows_of([unpack([datagram], message_flags=socket.MSG_DONTROUTE)])
    assert row.flags == FrameFlag.TRANSMITTED


def test_bytes_behind_a_short_payload_are_not_taken_for_payload() -> None:
    (row,) = rows_of([unpack([bytes.fromhex("23010000 02000000 1122FFFFFFFFFFFF")])])
    assert (row.length, row.data) == (2, b"\x11\x22")
