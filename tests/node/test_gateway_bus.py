"""The gateway on buses of python-can that live in this process, and its pytest fixtures."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from dbc.errors import DeviceError, InputError, SceneError
from drivers.ars408 import ScanAssembler
from drivers.can_bus import CanBus, open_bus
from drivers.can_frames import CanFrames, concatenate
from drivers.candump import write_candump
from drivers.scan import RadarScan
from node.control import ControlError, running, set_level
from node.gateway import Gateway, sensor_type_of
from node.gateway_scene import GatewayScene, build_gateway_scene
from node.pytest_plugin import OpenGateway, StartReplay
from tests.node.gateway_stream import merged, other_frames, radar_frames, wire

WITHIN_S = 20.0
"""How long a test waits for what must happen; a machine may be slow."""


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def buses(request: pytest.FixtureRequest) -> Iterator[tuple[str, str, CanBus, CanBus]]:
    """Return the names of the gateway's two buses, and the radar's and the ECU's end of them."""
    before, after = f"virtual:{request.node.name}-in", f"virtual:{request.node.name}-out"
    with open_bus(before) as radar, open_bus(after) as ecu:
        yield before, after, radar, ecu


def scene(source: str, **flags: object) -> GatewayScene:
    return build_gateway_scene(None, "radar", source, **flags)  # type: ignore[arg-type]


def receive(bus: CanBus, count: int) -> CanFrames:
    """Return at least so many frames."""
    batches: list[CanFrames] = []
    deadline_s = time.monotonic() + WITHIN_S
    while sum(map(len, batches)) < count and time.monotonic() < deadline_s:
        batches.append(bus.read(0.1))
    return concatenate(batches)


def eventually(condition: Callable[[], bool]) -> bool:
    deadline_s = time.monotonic() + WITHIN_S
    while time.monotonic() < deadline_s:
        if condition():
            return True
    return False


def clusters_of(frames: CanFrames) -> list[int]:
    items = ScanAssembler({0: "radar"}).feed(frames)
    return [len(item) for item in items if isinstance(item, RadarScan)]


@pytest.mark.parametrize(
    ("target", "sensor_type"),
    [
        ("can0", "radar"),
        ("virtual:b.1", "radar"),
        ("udp_multicast:239.74.163.2", "radar"),
        ("-", "camera"),
        ("pipe:frames", "camera"),
        ("/dev/video2", "camera"),
        ("out/x.mp4", "camera"),
        ("x.avi", "camera"),
    ],
)
def test_the_output_tells_what_passes(target: str, sensor_type: str) -> None:
    assert sensor_type_of(target) == sensor_type


def test_a_wire_and_then_a_worse_radar(buses: tuple[str, str, CanBus, CanBus]) -> None:
    before, after, radar, ecu = buses
    foreign = other_frames(radar_frames(0).stamp_ns[[5, 50]], [0x201, 0x300])
    frames = merged(radar_frames(0), foreign)
    with Gateway(scene(before), after) as gateway:
        radar.send(frames)
        assert wire(receive(ecu, len(frames))) == wire(frames)
        gateway.set("missed", 100)
        radar.send(frames)
        degraded = receive(ecu, len(foreign) + 3)
        for _ in range(20):
            degraded = concatenate([degraded, ecu.read(0.05)])
    passed = np.isin(degraded.can_id, foreign.can_id)
    assert wire(degraded.select(passed)) == wire(foreign)
    assert 0 < clusters_of(degraded)[0] < clusters_of(frames)[0]
    summary = gateway.summary()
    assert (summary["frames_in"], summary["frames_out"]) == (
        2 * len(frames),
        len(frames) + len(degraded),
    )
    assert (summary["scans"], summary["degraded"], summary["unsent"]) == (2, 1, 0)
    assert 0 < summary["latency_p50_ns"] <= summary["latency_p99_ns"]


def test_two_multicast_groups_are_two_buses() -> None:
    before, after = "udp_multicast:239.74.163.61", "udp_multicast:239.74.163.62"
    with open_bus(before) as radar, open_bus(after) as ecu:
        radar.send(radar_frames(0))
        if not len(radar.read(1.0)):
            pytest.skip("this network has no multicast")
        with Gateway(scene(before), after):
            radar.send(radar_frames(1))
            assert wire(receive(ecu, 81)) == wire(radar_frames(1))
            assert not len(ecu.read(0.2)), "nothing comes round"


def test_one_way_only_unless_both_are_asked_for(buses: tuple[str, str, CanBus, CanBus]) -> None:
    before, after, radar, ecu = buses
    motion = other_frames([0, 1], [0x300, 0x301])
    with Gateway(scene(before), after):
        ecu.send(motion)
        assert not len(radar.read(0.3))
    with Gateway(scene(before), after, both_ways=True) as gateway:
        ecu.send(motion)
        assert wire(receive(radar, 2)) == wire(motion)
        assert not len(ecu.read(0.2)), "what goes back must not come round"
        radar.send(radar_frames(0))
        assert len(receive(ecu, 81)) == 81
    assert gateway.summary()["frames_back"] == 2


def test_the_end_finishes_the_scan_in_flight(buses: tuple[str, str, CanBus, CanBus]) -> None:
    before, after, radar, ecu = buses
    frames = radar_frames(0)
    gateway = Gateway(scene(before), after)
    gateway.start()
    radar.send(frames.select(slice(0, 40)))
    assert len(receive(ecu, 40)) == 40
    end = Thread(target=gateway.stop)
    end.start()
    radar.send(frames.select(slice(40, None)))
    assert wire(receive(ecu, 41)) == wire(frames.select(slice(40, None)))
    end.join()
    radar.send(frames)
    assert not len(ecu.read(0.2))


def test_the_duration_ends_it(buses: tuple[str, str, CanBus, CanBus]) -> None:
    with Gateway(scene(buses[0], duration_s=0.05), buses[1]) as gateway:
        assert gateway.wait(WITHIN_S)


def test_live_control_reaches_the_running_gateway(buses: tuple[str, str, CanBus, CanBus]) -> None:
    before, after, radar, ecu = buses
    with Gateway(scene(before), after):
        set_level("radar", "drop", 100)
        radar.send(concatenate([radar_frames(0), other_frames([0], [0x201])]))
        assert receive(ecu, 1).can_id.tolist() == [0x201]
        with pytest.raises(SceneError, match="has no kind 'blur'"):
            set_level("radar", "blur", 10)
        with pytest.raises(SceneError, match="rate 101"):
            set_level("radar", "drop", 101)
        with pytest.raises(SceneError, match="level nan"):
            set_level("radar", "snr", float("nan"))
        with pytest.raises(ControlError, match="camera: has no running gateway; running: radar"):
            set_level("camera", "blur", 10)
    assert running() == []


def test_nothing_is_left_half_open(buses: tuple[str, str, CanBus, CanBus]) -> None:
    before, after, _, _ = buses
    with pytest.raises(DeviceError, match="unknown CAN interface"):
        Gateway(scene(before), "nonsense:x")
    with pytest.raises(InputError, match="is input and output"):
        Gateway(scene(before), before)
    with pytest.raises(InputError, match="hears what it sends"):
        Gateway(scene("udp_multicast:239.74.163.2"), after, both_ways=True)
    with Gateway(scene(before), after), pytest.raises(ControlError, match="already"):
        Gateway(scene(before), after)
    assert running() == []
    camera = build_gateway_scene(None, "camera", "world")
    with pytest.raises(InputError, match="--both-ways"):
        Gateway(camera, "-", both_ways=True)


class CountingEcu:
    """A unit under test: it is degraded while a scan has fewer than 40 clusters."""

    def __init__(self, bus: CanBus) -> None:
        self._assembler = ScanAssembler({0: "radar"})
        self._bus = bus

    def is_degraded(self) -> bool:
        scans = self._assembler.feed(self._bus.read(0.2))
        return any(isinstance(scan, RadarScan) and len(scan) < 40 for scan in scans)


def test_hardware_in_the_loop_in_ten_lines(
    buses: tuple[str, str, CanBus, CanBus],
    tmp_path: Path,
    murk_replay: StartReplay,
    murk_gateway: OpenGateway,
) -> None:
    before, after, _, bus = buses
    ecu = CountingEcu(bus)
    write_candump(tmp_path / "drive.log", [radar_frames(number) for number in range(5)])
    murk_replay(tmp_path / "drive.log", before, loop=True)
    gateway = murk_gateway(before, after)
    assert not any(ecu.is_degraded() for _ in range(5))
    gateway.set("missed", 60)
    assert eventually(ecu.is_degraded)


def test_a_bad_log_fails_the_test_that_replays_it(tmp_path: Path) -> None:
    (tmp_path / "bad.log").write_text("nonsense")
    (tmp_path / "test_replay.py").write_text(
        "import time\n"
        "def test_replay(murk_replay):\n"
        "    murk_replay('bad.log', 'virtual:bad')\n"
        "    time.sleep(0.3)\n"
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    result = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert "1 passed, 1 error" in result.stdout
    assert "bad.log:1: no CAN frame" in result.stdout


@pytest.mark.parametrize(
    ("code", "heavy"),
    [
        ("import node.pytest_plugin", ("numpy", "can", "cv2", "pydantic", "typer")),
        (
            "from node.gateway import *; from node.gateway_scene import *;"
            "Gateway(build_gateway_scene(None, 'radar', 'virtual:a'), 'virtual:b').stop()",
            ("cv2", "av", "onnxruntime", "matplotlib", "scipy"),
        ),
    ],
)
def test_nothing_is_loaded_that_is_not_needed(code: str, heavy: tuple[str, ...]) -> None:
    told = f"import sys; {code}; print([name for name in {heavy} if name in sys.modules])"
    result = subprocess.run(
        [sys.executable, "-c", told], capture_output=True, text=True, check=True
    )
    assert result.stdout == "[]\n"
