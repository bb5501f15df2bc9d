from __future__ import annotations

import itertools
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack

import can
import pytest
from can_strategies import Row, frames_of, rows, rows_of
from hypothesis import given

from dbc.errors import DeviceError
from drivers.can_bus import BusDown, CanBus, open_bus
from drivers.can_frames import CanFrames, FrameFlag
from drivers.socketcan import id_filters

_numbers = itertools.count()
FRAMES = [
    Row(0, 0x701, 8, bytes(range(1, 9)), 0, "can0"),
    Row(0, 0x1ABCDEF, 3, b"\1\2\3", FrameFlag.EXTENDED, "can0"),
    Row(0, 0x123, 0, b"", FrameFlag.REMOTE, "can0"),
    Row(0, 0x124, 12, b"\5" * 12, FrameFlag.FD | FrameFlag.BIT_RATE_SWITCH, "can0"),
]


def multicast_works() -> bool:
    try:
        with (
            can.Bus("239.74.163.2", "udp_multicast") as one,
            can.Bus("239.74.163.2", "udp_multicast") as two,
        ):
            one.send(can.Message(arbitration_id=1))
            return two.recv(1) is not None
    except (can.CanError, OSError):
        return False


@pytest.fixture(params=["virtual", "udp_multicast"])
def pair(request: pytest.FixtureRequest) -> Iterator[tuple[CanBus, CanBus]]:
    """A bus to send on and one to read from."""
    spec = f"virtual:murk{next(_numbers)}"
    if request.param == "udp_multicast":
        if not multicast_works():
            pytest.skip("this network has no multicast")
        spec = f"udp_multicast:239.74.163.{100 + next(_numbers) % 100}"
    with open_bus(spec) as sender, open_bus(spec) as receiver:
        yield sender, receiver


def read_all(bus: CanBus, count: int) -> list[CanFrames]:
    """Read until ``count`` frames are there, for five seconds at most."""
    batches: list[CanFrames] = []
    give_up = time.monotonic() + 5
    while sum(map(len, batches)) < count and time.monotonic() < give_up:
        batches.append(bus.read(0.1))
    return batches


def untimed(batches: list[CanFrames]) -> list[Row]:
    return [row._replace(stamp_ns=0, channel="can0") for row in rows_of(batches)]


def test_frames_of_every_kind_arrive_in_order(pair: tuple[CanBus, CanBus]) -> None:
    sender, receiver = pair
    before_ns = time.time_ns()
    sender.send(frames_of(FRAMES))
    batches = read_all(receiver, len(FRAMES))
    after_ns = time.time_ns()
    assert untimed(batches) == FRAMES
    for batch in batches:
        assert batch.channels == (receiver.name.partition(":")[2],)
        assert ((batch.stamp_ns >= before_ns - 1_000) & (batch.stamp_ns <= after_ns + 1_000)).all()
        assert batch.stamp_source == ("read" if "virtual" in receiver.name else "kernel")


def test_all_that_waits_comes_at_once(pair: tuple[CanBus, CanBus]) -> None:
    sender, receiver = pair
    many = [Row(0, k, 1, bytes([k + 1]), 0, "can0") for k in range(200)]
    sender.send(frames_of(many))
    time.sleep(0.05)
    assert untimed([receiver.read(1.0)]) == many


def test_a_silent_bus_gives_an_empty_batch(pair: tuple[CanBus, CanBus]) -> None:
    frames = pair[1].read(0.01)
    assert len(frames) == 0
    assert frames.data.shape == (0, 8)


@given(rows(min_size=1, max_size=5))
def test_whatever_is_sent_is_read(drawn: list[Row]) -> None:
    drawn = [row for row in drawn if not row.flags & FrameFlag.ERROR]
    spec = f"virtual:any{next(_numbers)}"
    with open_bus(spec) as sender, open_bus(spec) as receiver:
        sender.send(frames_of(drawn))
        expected = [
            row._replace(stamp_ns=0, channel="can0", flags=row.flags & ~FrameFlag.TRANSMITTED)
            for row in drawn
        ]
        assert untimed(read_all(receiver, len(drawn))) == expected


def test_only_the_wanted_identifiers_are_received() -> None:
    spec = f"virtual:ids{next(_numbers)}"
    with open_bus(spec) as sender, open_bus(spec, ids=[0x701, 0x1ABCDEF]) as receiver:
        sender.send(frames_of([*FRAMES, FRAMES[0]]))
        assert untimed([receiver.read(1.0)]) == [FRAMES[0], FRAMES[1], FRAMES[0]]


def test_a_listener_cannot_send() -> None:
    with (
        open_bus(f"virtual:quiet{next(_numbers)}", listen_only=True) as bus,
        pytest.raises(DeviceError, match="listening only"),
    ):
        bus.send(frames_of(FRAMES))


def test_error_frames_are_not_sent() -> None:
    with (
        open_bus(f"virtual:error{next(_numbers)}") as bus,
        pytest.raises(ValueError, match="error"),
    ):
        bus.send(frames_of([Row(0, 4, 8, b"", FrameFlag.ERROR, "can0")]))


def test_a_message_that_is_no_can_frame_is_counted_and_the_rest_read() -> None:
    if not multicast_works():
        pytest.skip("this network has no multicast")
    spec = "udp_multicast:239.74.163.99"
    with (
        open_bus(spec) as sender,
        open_bus(spec) as receiver,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        stranger.sendto(b"garbage", ("239.74.163.99", 43113))
        sender.send(frames_of(FRAMES[:1]))
        assert untimed(read_all(receiver, 1)) == FRAMES[:1]
        assert receiver.malformed == 1


@pytest.mark.parametrize("group", ["239.74.163.98", "ff15:7079:7468:6f6e:6465:6d6f:6d63:98"])
def test_two_groups_on_one_computer_do_not_hear_each_other(group: str) -> None:
    if not multicast_works():
        pytest.skip("this network has no multicast")
    other_group = group.replace("98", "97")
    try:
        bus = open_bus(f"udp_multicast:{group}")
    except DeviceError:
        pytest.skip("this network has no IPv6")
    with bus, open_bus(f"udp_multicast:{other_group}") as other:
        other.send(frames_of(FRAMES[:2]))
        bus.send(frames_of(FRAMES[:1]))
        assert untimed(read_all(bus, 2)) == FRAMES[:1]


class FullBuffer(can.BusABC):
    """Refuses each message some times before it takes it."""

    def __init__(self, refusals: int) -> None:
        self.refusals = refusals
        self.sent: list[can.Message] = []
        super().__init__("full")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.refusals:
            self.refusals -= 1
            raise can.CanOperationError("transmit queue full")
        self.sent.append(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        raise can.CanOperationError("the adapter is unplugged")


@pytest.fixture
def full(monkeypatch: pytest.MonkeyPatch) -> FullBuffer:
    bus = FullBuffer(refusals=3)
    monkeypatch.setattr(can, "Bus", lambda *_, **__: bus)
    return bus


def test_a_full_send_buffer_is_waited_for_and_counted(full: FullBuffer) -> None:
    with open_bus("virtual:full") as bus:
        bus.send(frames_of(FRAMES))
        assert bus.retries == 3
    assert [message.arbitration_id for message in full.sent] == [row.can_id for row in FRAMES]


def test_a_send_buffer_that_stays_full_is_down(
    full: FullBuffer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.python_can_bus.SEND_PATIENCE_S", 0.01)
    full.refusals = 10**9
    with open_bus("virtual:full") as bus, pytest.raises(BusDown, match="transmit queue full"):
        bus.send(frames_of(FRAMES))


@pytest.mark.usefixtures("full")
def test_a_bus_that_only_fails_is_down() -> None:
    with open_bus("virtual:full") as bus, pytest.raises(BusDown, match="unplugged"):
        bus.read(0.1)


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("nonsense:can0", "known are .*virtual"),
        ("virtual:", "names no channel"),
        ("", "names no channel"),
        ("udp_multicast:no.such.group.invalid", "cannot be opened"),
        ("pcan:PCAN_USBBUS1", "cannot be opened"),
    ],
)
def test_what_cannot_be_opened_is_one_line(spec: str, said: str) -> None:
    with pytest.raises(DeviceError, match=said) as caught:
        open_bus(spec)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


def has_can() -> bool:
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except (OSError, AttributeError):
        return False
    return True


@pytest.mark.skipif(has_can(), reason="this kernel has CAN")
@pytest.mark.parametrize("spec", ["can0", "vcan0", "socketcan:can0"])
def test_a_kernel_without_can_is_told_with_a_remedy(spec: str) -> None:
    with pytest.raises(DeviceError, match="kernel has no CAN; modprobe can_raw"):
        open_bus(spec)


def test_filters_are_what_the_kernel_expects() -> None:
    """linux/can.h, struct can_filter: identifier with its extended bit, then the mask."""
    filters = [*struct.iter_unpack("=II", id_filters([0x701, 0x1ABCDEF]))]
    assert filters == [(0x701, 0x9FFFFFFF), (0x81ABCDEF, 0x9FFFFFFF)]
    with pytest.raises(ValueError, match="at most 512"):
        id_filters(range(513))


def test_closing_twice_is_harmless() -> None:
    with ExitStack() as stack:
        bus = stack.enter_context(open_bus(f"virtual:twice{next(_numbers)}"))
        bus.close()
