"""What it costs to receive a radar from a CAN socket, and to pass it through the gateway.

Frames come from a SocketCAN interface where `vcan0` and `vcan1` are up. Elsewhere the receivers,
python-can's and ours, read the same frames as datagrams of UDP loopback, and the gateway runs
between two `virtual` buses of python-can; the unit of each point says which. A run time is CPU
time a frame, an error the frames that were lost.

Frames are received in two ways: so many at once that wait already, and at the full load of a bus
as they come, each receiver as it is used: python-can's loop wakes up for every frame; ours reads
what is there, then lets frames gather for about as long as the scan still needs.

The gateway runs at the full load of a 500 kbit/s bus, 4,000 frames/s, on one core together with
who sends to it and who hears it, at real-time priority where that is allowed: what else the
computer does is not its latency. Its CPU time is its own thread's. An added latency is from the
stamp of a frame to when the frame in its place had been sent. A scan that is changed is stored
until it is complete; from its first to its last frame that takes 62.5 ms on a full bus, and a
cycle is 72 ms. So is the first scan with low latency.

On the micro-machine's SocketCAN, where Python is some twenty times slower, the receivers' lines
are printed by `python -m tests.vm.machine -- .venv/bin/pytest tests/vm/test_vm_bench.py` and kept
in [bus-socketcan.txt](bus-socketcan.txt): ratios and losses are what counts there.
"""

from __future__ import annotations

import select
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from statistics import median
from threading import Thread
from time import monotonic, process_time, sleep, thread_time

import cantools.database
from can.interfaces.socketcan.socketcan import capture_message
from cantools.database.can import Database as ParsedDatabase

import dbc.codec
from drivers.ars408 import ScanAssembler
from drivers.bulk_receive import BulkReceiver, parse_ancillary
from drivers.can_frames import CanFrames, concatenate
from drivers.socketcan import can_interfaces
from drivers.socketcan_frames import FRAME, pack_frames, unpack_frames
from models.evaluate.report import Goal, Point
from node.bench.decode import simulated_log
from node.link_faults import FULL_LOAD_SPACING_NS
from node.live_sources import gather_s

CLUSTERS, CYCLES = 250, 16
WAITING = (1, 4, 16, 64, CLUSTERS + 1, CYCLES * (CLUSTERS + 1))
"""Frames that wait when the receiver reads; the last are all there are."""
MOST_READS = 251
"""Reads of a round, where few frames wait."""
FULL_LOAD = round(1e9 / FULL_LOAD_SPACING_NS)
"""Frames a second."""
LISTEN_S = 0.2
BUFFER_BYTES = 8 << 20
_SO_TIMESTAMPNS = 35
_SO_RCVBUFFORCE = 33

Receive = Callable[[int], int]
"""Takes so many frames from a socket and decodes them; returns how many there were."""


def run(quick: bool) -> Iterator[Point | Goal]:
    """Measure python-can and cantools against our receiver."""
    yield from _full_bus(quick)
    yield from _waiting_frames(quick)


def _waiting_frames(quick: bool) -> Iterator[Point | Goal]:
    """Measure both by how many frames wait at a read."""
    datagrams = list(pack_frames(simulated_log(CLUSTERS, quality=False, cycles=CYCLES)))
    rounds = 3 if quick else 11
    with ExitStack() as opened:
        senders, receivers = zip(*(_sockets(opened, number) for number in (0, 1)), strict=True)
        takers = {
            "python-can and cantools": _by_python_can(receivers[0]),
            "murk": _in_bulk(receivers[1]),
        }
        costs: dict[tuple[str, int], list[float]] = {}
        lost = dict.fromkeys(takers, 0)
        for waiting in WAITING:
            for _ in range(rounds):
                for sender, (variant, take) in zip(senders, takers.items(), strict=True):
                    some = datagrams[: waiting * MOST_READS]
                    cost_us, came = _round(sender, some, take, waiting)
                    costs.setdefault((variant, waiting), []).append(cost_us)
                    lost[variant] += len(some) - came
    transport = _transport()
    unit = f"frames lost ({transport})"
    for (variant, waiting), costs_us in costs.items():
        yield Point(variant, f"waiting={waiting}", median(costs_us), lost[variant], unit)
    theirs, ours = (costs[variant, WAITING[-1]] for variant in takers)
    ratio = median(a / b for a, b in zip(theirs, ours, strict=True))
    name = "frames a CPU second from socket to scans, a second of a full bus waiting"
    yield Goal(f"{name}, times python-can and cantools ({transport})", ratio, 5.0)


def _full_bus(quick: bool) -> Iterator[Point]:
    """Measure both while the frames of a full bus come one by one, each read as its users do."""
    cycles = (1 if quick else 10) * FULL_LOAD // (CLUSTERS + 1)
    datagrams = list(pack_frames(simulated_log(CLUSTERS, quality=False, cycles=cycles)))
    readers = {"python-can and cantools": _read_one_by_one, "murk": _read_gathered}
    for variant, read in readers.items():
        with ExitStack() as opened:
            sender, receiver = _sockets(opened, 0)
            cost_us, came = _paced(sender, datagrams, read(receiver))
        unit = f"frames lost ({_transport()})"
        yield Point(variant, "a full bus as it comes", cost_us, len(datagrams) - came, unit)


def _transport() -> str:
    return "SocketCAN" if has_socketcan() else "UDP loopback"


def has_socketcan() -> bool:
    """Tell whether there are two virtual CAN buses of the kernel's, up."""
    up = [name for name in can_interfaces() if _is_up(name)]
    return {"vcan0", "vcan1"} <= set(up)


def _is_up(interface: str) -> bool:
    return bool(int(Path("/sys/class/net", interface, "flags").read_text(), 16) & 1)


def _sockets(opened: ExitStack, number: int) -> tuple[socket.socket, socket.socket]:
    """Return two connected sockets, one to send and one to receive."""
    pair = []
    for _ in range(2):
        if has_socketcan():
            one = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
            one.bind((f"vcan{number}",))
        else:
            one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            one.bind(("127.0.0.1", 0))
        pair.append(opened.enter_context(one))
    sender, receiver = pair
    if sender.family == socket.AF_INET:
        sender.connect(receiver.getsockname())
    with suppress(PermissionError):
        receiver.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, BUFFER_BYTES)
    receiver.setblocking(False)
    return sender, receiver


def _round(
    sender: socket.socket, datagrams: list[bytes], take: Receive, waiting: int
) -> tuple[float, int]:
    """Send all frames, so many at a time, each time to be received; CPU µs a frame, and frames."""
    spent_s, came = 0.0, 0
    for first in range(0, len(datagrams), waiting):
        batch = datagrams[first : first + waiting]
        for datagram in batch:
            sender.send(datagram)
        start_s = process_time()
        came += take(len(batch))
        spent_s += process_time() - start_s
    return spent_s * 1e6 / len(datagrams), came


def _paced(
    sender: socket.socket, datagrams: list[bytes], read: Callable[[], int]
) -> tuple[float, int]:
    """Send frames at the full load of a bus; CPU µs a frame of who reads them, and frames."""
    begin_s = monotonic()

    def send() -> None:
        for number, datagram in enumerate(datagrams):
            sleep(max(0.0, begin_s + number / FULL_LOAD - monotonic()))
            sender.send(datagram)

    other = Thread(target=send)
    other.start()
    start_s, came = thread_time(), 0
    while (count := read()) or other.is_alive():
        came += count
    spent_s = thread_time() - start_s
    other.join()
    return spent_s * 1e6 / len(datagrams), came


def _read_one_by_one(receiver: socket.socket) -> Callable[[], int]:
    """Wait for a message, receive and decode it, as a loop around ``recv`` does."""
    take = _by_python_can(receiver, LISTEN_S)
    return lambda: take(1)


def _read_gathered(receiver: socket.socket) -> Callable[[], int]:
    """Wait for frames, take in all, and pause, as ``CanBusSource.messages`` does."""
    bulk = BulkReceiver(receiver, FRAME.itemsize)
    assembler = ScanAssembler()

    def read() -> int:
        select.select([receiver], [], [], LISTEN_S)
        frames = _received(bulk)
        assembler.feed(frames)
        sleep(gather_s(assembler.missing, frames))
        return len(frames)

    return read


def _by_python_can(receiver: socket.socket, patience_s: float = 0.0) -> Receive:
    """Receive as ``SocketcanBus.recv`` does, and decode each message with cantools."""
    database = cantools.database.load_file(Path(dbc.codec.__file__).with_name("ars408.dbc"))
    assert isinstance(database, ParsedDatabase)
    receiver.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)

    def take(count: int) -> int:
        for number in range(count):
            if not select.select([receiver], [], [], patience_s)[0]:
                return number
            message = capture_message(receiver)
            assert message is not None
            database.decode_message(
                message.arbitration_id, bytes(message.data), decode_choices=False
            )
        return count

    return take


def _in_bulk(receiver: socket.socket) -> Receive:
    """Receive as ``SocketCanBus.read`` does, and assemble scans."""
    bulk = BulkReceiver(receiver, FRAME.itemsize)
    assembler = ScanAssembler()

    def take(count: int) -> int:
        came = 0
        while came < count and select.select([receiver], [], [], 0)[0]:
            batches = [_received(bulk)]
            while len(batches[-1]) == bulk.batch:
                batches.append(_received(bulk))
            frames = concatenate(batches)
            assembler.feed(frames)
            came += len(frames)
        return came

    return take


def _received(bulk: BulkReceiver) -> CanFrames:
    received = bulk.receive()
    beside = parse_ancillary(received.control, received.control_length)
    return unpack_frames(
        received.data,
        received.length,
        received.flags,
        beside.software_ns,
        channel="bus",
        stamp_source="kernel",
        dropped=beside.dropped,
    )
