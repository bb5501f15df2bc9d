"""A whole run on real CAN and a real camera: what comes in, goes down and comes back."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest

from drivers.ars408 import ScanAssembler
from drivers.can_frames import CanFrames, concatenate
from drivers.candump import read_candump, write_candump
from drivers.scan import RadarScan
from models.estimate.level import NoiseLevel
from node.bus.in_process import Bus
from node.pipeline import Pipeline
from node.plan import plan
from node.scene import check_scene
from tests.vm.marks import needs_machine

pytestmark = needs_machine

PATIENCE_S = 120.0
CYCLES = 40
STATUS_ID = 0x600
FULL_LOAD_NS = 250_000
"""From frame to frame on a full bus."""


class Run:
    """A pipeline in a thread of its own, with all that it published."""

    def __init__(self, sensor: dict[str, Any]) -> None:
        self.bus = Bus()
        scene = check_scene({"sensors": [sensor]}, "test")
        self.pipeline = Pipeline(plan(scene), self.bus)
        name = sensor["name"]
        self.scans = self.bus.subscribe(f"/murk/{name}/scan", depth=10_000)
        self.events = self.bus.subscribe(f"/murk/{name}/event", depth=1000)
        self.levels: list[NoiseLevel] = []
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        for level in self.pipeline.run():
            self.levels.append(level)

    def wait_for(self, count: int) -> None:
        """Wait until so many levels have come."""
        give_up = time.monotonic() + PATIENCE_S
        while len(self.levels) < count and time.monotonic() < give_up:
            time.sleep(0.05)
        assert len(self.levels) >= count, self.pipeline.summary()

    def wait_until(self, condition: Callable[[dict[str, Any]], bool]) -> None:
        """Wait until the counts so far meet a condition."""
        give_up = time.monotonic() + PATIENCE_S
        while not condition(self._counts()) and time.monotonic() < give_up:
            time.sleep(0.05)
        assert condition(self._counts()), self._counts()

    def states(self) -> list[str]:
        self.events.close()
        return [event.state for event in self.events]

    def close(self) -> dict[str, Any]:
        self.pipeline.stop()
        self._thread.join(30)
        assert not self._thread.is_alive()
        self.scans.close()
        return self._counts()

    def _counts(self) -> dict[str, Any]:
        counts: dict[str, Any] = next(iter(self.pipeline.summary()["sensors"].values()))
        return counts


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Some seconds of the simulated radar as a candump log."""
    from models.world.radar import WorldRadar
    from models.world.road import World

    path = tmp_path / "radar.log"
    radar = WorldRadar(World(seed=3, duration_s=CYCLES * 0.072))
    write_candump(path, map(_to_microseconds, radar.frames()))
    return path


def _to_microseconds(frames: CanFrames) -> CanFrames:
    """Round stamps to what canplayer reads."""
    return replace(frames, stamp_ns=frames.stamp_ns // 1000 * 1000)


@pytest.fixture
def up() -> Iterator[None]:
    yield
    ip("up")


def ip(state: str) -> None:
    subprocess.run(["ip", "link", "set", "vcan0", state], check=True)


def play(log: Path, *options: str, bus: str = "vcan0") -> None:
    """Replay a log by the time of its frames."""
    subprocess.run(["canplayer", "-I", str(log), *options, f"{bus}=can0"], check=True)


def scans_of(log: Path) -> list[RadarScan]:
    assembler = ScanAssembler({0: "radar"})
    items = [item for frames in read_candump(log) for item in assembler.feed(frames)]
    return [item for item in (*items, *assembler.flush()) if isinstance(item, RadarScan)]


@pytest.mark.parametrize("recording", ["simulated", "recorded"])
def test_every_scan_of_a_replayed_log_arrives_with_the_kernels_stamps(
    recording: str, request: pytest.FixtureRequest
) -> None:
    if recording == "simulated":
        log = request.getfixturevalue("log")
    else:
        log = request.getfixturevalue("data") / "radar" / "nuscenes_mini" / "scene-0061.log"
    expected = scans_of(log)
    run = Run({"name": "radar", "type": "radar", "source": "vcan0"})
    play(log)
    run.wait_for(len(expected))
    counts = run.close()
    got = list(run.scans)
    assert [scan.meas_counter for scan in got] == [scan.meas_counter for scan in expected]
    assert [scan.x.tolist() for scan in got] == [scan.x.tolist() for scan in expected]
    assert {scan.stamp_source for scan in got} == {"kernel"}
    assert counts["frames_lost"] == counts["cycles_lost"] == counts["dropped_by_source"] == 0
    assert counts["failures"] == 0
    assert abs(time.time_ns() - got[-1].stamp_ns) < PATIENCE_S * 1e9


def test_at_the_full_load_of_a_bus_no_frame_is_lost(data: Path, tmp_path: Path) -> None:
    recorded = data / "radar" / "nuscenes_mini" / "scene-0061.log"
    frames = concatenate(list(read_candump(recorded)))
    log = tmp_path / "full.log"
    write_candump(log, [replace(frames, stamp_ns=np.arange(len(frames)) * FULL_LOAD_NS)])
    run = Run({"name": "radar", "type": "radar", "source": "vcan0"})
    play(log, "-g", "1")
    expected = scans_of(log)
    run.wait_until(lambda counts: counts["received"] >= len(expected))
    counts = run.close()
    assert counts["received"] == len(expected)
    assert counts["estimated"] + counts["dropped_by_queue"] == len(expected)
    assert counts["frames_lost"] == counts["cycles_lost"] == counts["dropped_by_source"] == 0
    assert counts["failures"] == 0
    assert {scan.stamp_source for scan in run.scans} == {"kernel"}


@pytest.fixture
def interface() -> Iterator[str]:
    """A CAN interface of this test's own."""
    name = "vcan9"
    link("add", "dev", name, "type", "vcan")
    link("set", name, "up")
    yield name
    subprocess.run(["ip", "link", "del", name], check=False, capture_output=True)


def link(*arguments: str) -> None:
    subprocess.run(["ip", "link", *arguments], check=True)


def test_an_interface_that_is_pulled_out_is_waited_for(interface: str, log: Path) -> None:
    run = Run({"name": "radar", "type": "radar", "source": interface})
    play(log, bus=interface)
    run.wait_for(CYCLES - 5)
    link("del", interface)
    run.wait_until(lambda counts: "lost" in counts.get("events", {}))
    link("add", "dev", interface, "type", "vcan")
    link("set", interface, "up")
    time.sleep(2.5)  # it tries again every two seconds at least
    before = len(run.levels)
    play(log, bus=interface)
    run.wait_for(before + CYCLES // 2)
    counts = run.close()
    states = run.states()
    assert "ok" in states[states.index("lost") :]
    assert counts["dropped_by_source"] == counts["failures"] == 0


@pytest.mark.usefixtures("up")
def test_a_bus_that_goes_down_and_up_is_told_and_what_was_not_heard_is_counted(
    log: Path, tmp_path: Path
) -> None:
    frames = concatenate(list(read_candump(log)))
    starts = np.flatnonzero(frames.can_id == STATUS_ID)
    heard, missed = 20, 10
    parts = tmp_path / "before.log", tmp_path / "after.log"
    write_candump(parts[0], [frames.select(slice(0, starts[heard]))])
    write_candump(parts[1], [frames.select(slice(starts[heard + missed], None))])
    run = Run({"name": "radar", "type": "radar", "source": "vcan0"})
    play(parts[0])
    run.wait_for(heard)
    ip("down")
    time.sleep(1.0)
    ip("up")
    time.sleep(0.5)
    play(parts[1])
    run.wait_for(len(starts) - missed)
    counts = run.close()
    assert counts["received"] == len(starts) - missed
    assert counts["cycles_lost"] == missed
    assert counts["frames_lost"] == counts["dropped_by_source"] == 0
    states = run.states()
    assert "lost" in states
    assert "ok" in states[states.index("lost") :]


def test_a_silent_radar_is_stale_and_one_that_never_spoke_is_never_seen(log: Path) -> None:
    run = Run({"name": "radar", "type": "radar", "source": "vcan0"})
    time.sleep(2.0)
    play(log)
    run.wait_for(CYCLES - 5)
    time.sleep(2.0)
    run.close()
    states = run.states()
    assert states[:2] == ["never_seen", "ok"]
    assert states[-1] == "stale"


def test_a_camera_that_is_unplugged_comes_back() -> None:
    run = Run({"name": "camera", "type": "camera", "source": "/dev/video0"})
    run.wait_for(5)
    subprocess.run(["v4l2-ctl", "-d", "/dev/video0", "-c", "disconnect=1"], check=False)
    time.sleep(2.0)
    subprocess.run(["v4l2-ctl", "-d", "/dev/video0", "-c", "disconnect=0"], check=False)
    before = len(run.levels)
    run.wait_for(before + 5)
    counts = run.close()
    states = run.states()
    assert "lost" in states
    assert "ok" in states[states.index("lost") :]
    assert counts["failures"] == 0
    captured = run.levels[-1].sequence - run.levels[0].sequence + 1
    assert captured == len(run.levels) + run.levels[-1].dropped
