"""Real SocketCAN, with can-utils as the other side."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from dbc.errors import DeviceError
from drivers import socketcan
from drivers.can_bus import BusDown, CanBus, open_bus
from drivers.can_frames import CanFrames, FrameFlag, concatenate
from drivers.candump import read_candump, write_candump
from drivers.socketcan_frames import pack_frames
from tests.vm.marks import needs_machine

pytestmark = needs_machine

FD = FrameFlag.FD | FrameFlag.BIT_RATE_SWITCH


@pytest.fixture
def interface() -> Iterator[str]:
    """A CAN interface of this test's own."""
    name = "vcan9"
    ip("link", "add", "dev", name, "type", "vcan")
    ip("link", "set", name, "mtu", "72", "up")
    yield name
    subprocess.run(["ip", "link", "del", name], check=False, capture_output=True)


def ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True)


def frames_of(
    can_ids: list[int], flags: list[int] | None = None, lengths: list[int] | None = None
) -> CanFrames:
    count = len(can_ids)
    length = np.array(lengths or [8] * count, np.uint8)
    data = np.random.default_rng(count).integers(0, 256, (count, 64), np.uint8)
    data[np.arange(64) >= length[:, None]] = 0
    return CanFrames(
        stamp_ns=np.zeros(count, np.int64),
        can_id=np.array(can_ids, np.uint32),
        length=length,
        data=data,
        flags=np.array(flags or [0] * count, np.uint8),
        channel=np.zeros(count, np.uint8),
    )


KINDS = frames_of([0x701, 0x1ABCDEF, 0x7FF, 0x124], [0, FrameFlag.EXTENDED, 0, FD], [8, 3, 0, 12])


def read_all(bus: CanBus, count: int, patience_s: float = 20.0) -> CanFrames:
    batches: list[CanFrames] = []
    give_up = time.monotonic() + patience_s
    while sum(map(len, batches)) < count and time.monotonic() < give_up:
        batches.append(bus.read(0.2))
    return concatenate(batches)


def same(heard: CanFrames, sent: CanFrames) -> bool:
    width = heard.data.shape[1]
    return (
        heard.can_id.tolist() == sent.can_id.tolist()
        and heard.length.tolist() == sent.length.tolist()
        and (heard.flags & ~FrameFlag.TRANSMITTED).tolist() == sent.flags.tolist()
        and np.array_equal(heard.data, sent.data[:, :width])
    )


def listeners(interface: str) -> int:
    """Return how many sockets hear all frames of an interface."""
    lines = Path("/proc/net/can/rcvlist_all").read_text().splitlines()
    return sum(line.split()[:1] == [interface] for line in lines)


@contextmanager
def candump(interface: str, count: int, path: Path) -> Iterator[None]:
    """Have candump write a log of so many frames; it listens when the block begins."""
    already = listeners(interface)
    command = ["candump", "-L", "-n", str(count), "-r", "8000000", interface]
    with path.open("wb") as log, subprocess.Popen(command, stdout=log) as process:
        try:
            give_up = time.monotonic() + 20
            while listeners(interface) == already and time.monotonic() < give_up:
                time.sleep(0.01)
            yield
            process.wait(30)
        finally:
            process.kill()


def test_what_we_send_is_what_candump_sees(interface: str, tmp_path: Path) -> None:
    log = tmp_path / "heard.log"
    with open_bus(interface) as bus, candump(interface, len(KINDS), log):
        bus.send(KINDS)
    assert same(concatenate(list(read_candump(log))), KINDS)


def test_what_candump_sees_is_what_we_read_with_the_same_stamps(
    interface: str, tmp_path: Path
) -> None:
    count, log = 200, tmp_path / "heard.log"
    with open_bus(interface) as bus:
        with candump(interface, count, log):
            subprocess.run(["cangen", interface, "-g1", f"-n{count}", "-e", "-m"], check=True)
        heard = read_all(bus, count)
        assert bus.dropped == 0
    seen = concatenate(list(read_candump(log)))
    assert same(heard, seen)
    assert heard.stamp_source == "kernel"
    assert heard.channels == (interface,)
    np.testing.assert_array_equal(heard.stamp_ns // 1000, seen.stamp_ns // 1000)
    assert (heard.flags & FrameFlag.TRANSMITTED).all()


def test_a_real_recording_played_at_full_speed_arrives_whole(interface: str, data: Path) -> None:
    log = data / "radar" / "candump" / "object_mode_38s.log"
    recording = concatenate(list(read_candump(log)))
    with open_bus(interface) as bus:
        subprocess.run(["canplayer", "-I", log, "-t", f"{interface}=can1"], check=True)
        heard = read_all(bus, len(recording))
        assert len(bus.read(0.1)) == 0
        assert bus.dropped == 0
    assert same(heard, recording)


def test_murk_play_keeps_time_on_a_real_interface(
    interface: str, data: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from node import cli
    from node.player import Recording

    log = data / "radar" / "candump" / "object_mode_38s.log"
    arguments = ["play", str(log), interface, "--start", "5", "--end", "8", "--json"]
    monkeypatch.setattr("sys.argv", ["murk", *arguments])
    with open_bus(interface) as bus:
        with pytest.raises(SystemExit) as caught:
            cli.main()
        assert not caught.value.code
        summary = json.loads(capsys.readouterr().out)
        heard = read_all(bus, summary["frames"])
    laps = list(Recording([log], start_s=5, end_s=8).lap())
    assert same(heard, concatenate([frames for _, frames in laps]))
    due_ns = np.concatenate([due for due, _ in laps])
    late_ns = (heard.stamp_ns - heard.stamp_ns[0]) - (due_ns - due_ns[0])
    assert np.percentile(np.abs(late_ns - np.median(late_ns)), 50) < 20_000_000


def test_a_reader_that_stalls_knows_exactly_what_it_lost(
    interface: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socketcan, "_RECEIVE_BUFFER_BYTES", 50_000)
    with open_bus(interface) as stalled, open_bus(interface) as sender:
        sender.send(frames_of([0x701] * 1000))
        kept = read_all(stalled, 1000, patience_s=1.0)
        assert 0 < len(kept) < 1000
        assert kept.dropped == 0
        sender.send(frames_of([0x702]))
        (after,) = (stalled.read(1.0),)
        assert after.can_id.tolist() == [0x702]
        assert after.dropped == stalled.dropped == 1000 - len(kept)


def test_two_seconds_of_a_full_bus_wait_in_the_buffer(interface: str) -> None:
    with open_bus(interface) as bus, open_bus(interface) as sender:
        sender.send(frames_of([0x701] * 8000))
        assert len(read_all(bus, 8000)) == 8000
        sender.send(frames_of([0x701]))
        assert bus.read(1.0).dropped == 0


def test_only_the_wanted_identifiers_wake_us_but_errors_always_do(interface: str) -> None:
    error = frames_of([0x20], [FrameFlag.ERROR])
    with open_bus(interface, ids=[0x701, 0x1ABCDEF]) as bus, open_bus(interface) as sender:
        sender.send(KINDS)
        assert isinstance(sender, socketcan.SocketCanBus)
        sender._socket.send(next(pack_frames(error)))
        heard = read_all(bus, 3, patience_s=1.0)
    assert heard.can_id.tolist() == [0x701, 0x1ABCDEF, 0x20]
    assert (heard.flags & FrameFlag.ERROR).astype(bool).tolist() == [False, False, True]


def test_an_interface_that_goes_down_and_comes_back_goes_on(interface: str) -> None:
    with open_bus(interface) as bus, open_bus(interface) as sender:
        sender.send(frames_of([1, 2]))
        ip("link", "set", interface, "down")
        with pytest.raises(BusDown, match="network is down") as caught:
            bus.read(1.0)
        assert not caught.value.gone
        began = time.monotonic()
        heard = read_all(bus, 2, patience_s=1.0)
        assert heard.can_id.tolist() in ([1, 2], [])
        with pytest.raises(BusDown, match="network is down"):
            sender.send(frames_of([3]))
        while len(bus.read(0.2)):
            pass
        assert time.monotonic() - began >= 0.2, "a silent bus is waited for, not polled"
        ip("link", "set", interface, "up")
        sender.send(frames_of([4]))
        assert read_all(bus, 1).can_id.tolist() == [4]


def test_an_interface_that_is_gone_says_so_every_time(interface: str) -> None:
    with open_bus(interface) as bus:
        ip("link", "del", interface)
        for _ in range(2):
            with pytest.raises(BusDown, match="has gone") as caught:
                bus.read(0.2)
            assert caught.value.gone
        with pytest.raises(BusDown, match="has gone"):
            bus.send(frames_of([1]))


def test_what_cannot_be_opened_has_a_remedy(interface: str) -> None:
    with pytest.raises(DeviceError, match=r"no such CAN interface; there are .*vcan0"):
        open_bus("vcan77")
    with pytest.raises(DeviceError, match="no such CAN interface"):
        open_bus("lo")
    ip("link", "set", interface, "down")
    with pytest.raises(DeviceError, match=f"is down; ip link set {interface} up"):
        open_bus(interface)


def test_a_classic_interface_refuses_can_fd(interface: str) -> None:
    ip("link", "set", interface, "down")
    ip("link", "set", interface, "mtu", "16", "up")
    with open_bus(interface) as bus, pytest.raises(DeviceError, match="cannot carry CAN FD"):
        bus.send(KINDS)


def test_write_candump_is_what_canplayer_takes(interface: str, tmp_path: Path) -> None:
    path = tmp_path / "ours.log"
    write_candump(path, [KINDS])
    with open_bus(interface) as bus:
        subprocess.run(["canplayer", "-I", path, "-t", f"{interface}=can0"], check=True)
        assert same(read_all(bus, len(KINDS)), KINDS)
