from __future__ import annotations

import socket
import time
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bulk_receive import (
    CONTROL,
    SO_RXQ_OVFL,
    SO_TIMESTAMPING,
    BulkReceiver,
    Received,
    parse_ancillary,
)

STAMPED, STAMPED_AND_COUNTED = 64, 88


def control_of(software_ns: int, hardware_ns: int, dropped: int | None) -> tuple[bytes, int]:
    control = np.zeros(1, CONTROL)
    control["stamp_type"], control["stamp_bytes"] = SO_TIMESTAMPING, STAMPED
    control["software_s"], control["software_ns"] = divmod(software_ns, 10**9)
    control["hardware_s"], control["hardware_ns"] = divmod(hardware_ns, 10**9)
    if dropped is not None:
        control["drop_type"], control["dropped"] = SO_RXQ_OVFL, dropped
    return control.tobytes(), STAMPED if dropped is None else STAMPED_AND_COUNTED


stamps = st.integers(0, 2**62)


@given(st.lists(st.tuples(stamps, stamps, st.none() | st.integers(0, 2**32 - 1)), min_size=1))
def test_stamps_and_the_highest_drop_count_are_read(
    said: list[tuple[int, int, int | None]],
) -> None:
    controls, lengths = zip(*(control_of(*each) for each in said), strict=True)
    control = np.frombuffer(b"".join(controls), CONTROL)
    ancillary = parse_ancillary(control, np.array(lengths, np.uintp))
    assert ancillary.software_ns.tolist() == [software for software, _, _ in said]
    assert ancillary.hardware_ns.tolist() == [hardware for _, hardware, _ in said]
    assert ancillary.dropped == max(dropped or 0 for _, _, dropped in said)


def test_what_was_not_filled_is_not_read() -> None:
    controls = [control_of(1, 2, 3), control_of(4, 5, 6)]
    control = np.frombuffer(b"".join(control for control, _ in controls), CONTROL)
    ancillary = parse_ancillary(control, np.array([0, STAMPED], np.uintp))
    assert ancillary.software_ns.tolist() == [0, 4]
    assert ancillary.hardware_ns.tolist() == [0, 5]
    assert ancillary.dropped == 0


def test_no_datagram_says_nothing() -> None:
    ancillary = parse_ancillary(np.zeros(0, CONTROL), np.zeros(0, np.uintp))
    assert len(ancillary.software_ns) == 0
    assert ancillary.dropped == 0


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        receiver.bind(("127.0.0.1", 0))
        sender.connect(receiver.getsockname())
        yield receiver, sender


def receive_all(receiver: BulkReceiver) -> Iterator[Received]:
    while len((received := receiver.receive()).length):
        yield received


def test_datagrams_come_whole_in_order_and_stamped_by_the_kernel(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    receiver = BulkReceiver(pair[0], datagram_bytes=72, batch=16)
    sent = [bytes([k]) * (16 if k % 3 else 72) for k in range(50)]
    before_ns = time.time_ns()
    for datagram in sent:
        pair[1].send(datagram)
    after_ns = time.time_ns()
    read: list[bytes] = []
    stamps_ns: list[int] = []
    for received in receive_all(receiver):
        assert len(received.length) <= 16
        rows = zip(received.data, received.length, strict=True)
        read += [row[:length].tobytes() for row, length in rows]
        ancillary = parse_ancillary(received.control, received.control_length)
        stamps_ns += ancillary.software_ns.tolist()
        assert ancillary.dropped == 0
        assert not ancillary.hardware_ns.any()
    assert read == sent
    assert stamps_ns == sorted(stamps_ns)
    assert before_ns <= stamps_ns[0]
    assert stamps_ns[-1] <= after_ns


def test_the_kernels_drops_are_counted_exactly(pair: tuple[socket.socket, socket.socket]) -> None:
    pair[0].setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 20_000)
    receiver = BulkReceiver(pair[0], datagram_bytes=16)
    for _ in range(1_000):
        pair[1].send(bytes(16))
    kept = sum(len(received.length) for received in receive_all(receiver))
    assert 0 < kept < 1_000
    pair[1].send(bytes(16))  # the counter comes with the next datagram
    received = receiver.receive()
    assert parse_ancillary(received.control, received.control_length).dropped == 1_000 - kept


def test_an_empty_socket_gives_an_empty_batch_at_once(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    receiver = BulkReceiver(pair[0], datagram_bytes=16)
    assert len(receiver.receive().length) == 0


def test_what_the_kernel_reports_is_raised(pair: tuple[socket.socket, socket.socket]) -> None:
    receiver = BulkReceiver(pair[1], datagram_bytes=16)
    pair[0].close()
    pair[1].send(b"nobody listens")
    with pytest.raises(ConnectionRefusedError):
        receiver.receive()
