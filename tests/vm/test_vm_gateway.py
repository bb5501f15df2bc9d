"""The gateway between real buses and real video devices, with can-utils as both other sides."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import cantools
import cv2
import numpy as np
import pytest

import dbc
from drivers.ars408 import ScanAssembler
from drivers.can_bus import open_bus
from drivers.can_frames import CanFrames, concatenate
from drivers.candump import read_candump, write_candump
from drivers.scan import RadarScan
from node import cli
from node.control import running, set_level
from node.estimator import Estimator
from node.gateway import Gateway
from node.gateway_scene import build_gateway_scene
from tests.vm.marks import needs_machine

pytestmark = needs_machine

CYCLE_NS = 72_000_000
WIRE_FRAMES = 100_000
FULL_LOAD = 4000
SLOW_NS = 4_000_000
"""From frame to frame, that emulated Python keeps pace."""
PATIENCE_S = 60.0


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


@contextmanager
def candump(log: Path) -> Iterator[None]:
    """Have candump write all that vcan1 carries during the block to a log."""
    with log.open("wb") as file:
        process = subprocess.Popen(["candump", "-L", "-r", "8000000", "vcan1"], stdout=file)
        try:
            listeners = Path("/proc/net/can/rcvlist_all")
            wait_until(lambda: "vcan1" in listeners.read_text())
            yield
            time.sleep(0.5)
        finally:
            process.terminate()
            process.wait()


def heard_in(log: Path) -> CanFrames:
    return concatenate(list(read_candump(log)))


def wait_until(condition: Callable[[], bool]) -> None:
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.05)


def wait_until_sent(gateway: Gateway, count: int) -> None:
    wait_until(lambda: gateway.summary()["frames_out"] >= count)


def canplayer(log: Path) -> None:
    subprocess.run(["canplayer", "-I", log, "-g", "1", "vcan0=can0"], check=True)


def scene(*inject: str) -> Any:
    return build_gateway_scene(None, "radar", "vcan0", inject=inject)


def scans(frames: CanFrames) -> list[RadarScan]:
    assembler = ScanAssembler({0: "radar"})
    items = [*assembler.feed(frames), *assembler.flush()]
    return [item for item in items if isinstance(item, RadarScan)]


def drive(data: Path, cycles: int) -> CanFrames:
    """Return so many cycles of a real recording, at the radar's pace instead of two a second."""
    frames = concatenate(list(read_candump(data / "radar" / "nuscenes_mini" / "scene-0061.log")))
    begins = np.append(np.flatnonzero(frames.can_id == 0x600), len(frames))
    some = np.resize(np.arange(len(begins) - 1), cycles)
    rows = np.concatenate([np.arange(begins[k], begins[k + 1]) for k in some])
    played = frames.select(rows)
    cycle = np.cumsum(played.can_id == 0x600) - 1
    within_ns = played.stamp_ns - played.stamp_ns[played.can_id == 0x600][cycle]
    return replace(played, stamp_ns=played.stamp_ns[0] + cycle * CYCLE_NS + within_ns)


def same(heard: CanFrames, sent: CanFrames) -> bool:
    return all(
        np.array_equal(getattr(heard, name), getattr(sent, name))
        for name in ("can_id", "length", "data")
    )


def test_level_0_is_a_wire_to_the_bit_at_the_full_load_of_a_bus(data: Path, tmp_path: Path) -> None:
    sent = drive(data, 450).select(slice(0, WIRE_FRAMES))
    sent = replace(sent, stamp_ns=np.arange(len(sent)) * (10**9 // FULL_LOAD))
    write_candump(tmp_path / "sent.log", [sent])
    with candump(tmp_path / "heard.log"), Gateway(scene(), "vcan1") as gateway:
        canplayer(tmp_path / "sent.log")
        wait_until_sent(gateway, len(sent))
    assert len(sent) == WIRE_FRAMES
    assert same(heard_in(tmp_path / "heard.log"), sent)
    assert gateway.summary()["dropped"] == 0


def test_a_degraded_radar_is_still_a_radar_and_murk_sees_how_bad_it_is(
    data: Path, tmp_path: Path
) -> None:
    sent = drive(data, 60)
    write_candump(tmp_path / "sent.log", [sent])
    with candump(tmp_path / "heard.log"), Gateway(scene("radar:snr:60"), "vcan1") as gateway:
        canplayer(tmp_path / "sent.log")
        wait_until(lambda: gateway.summary()["degraded"] == 60)
    heard = heard_in(tmp_path / "heard.log")
    came, went = scans(sent), scans(heard)
    assert [scan.meas_counter for scan in went] == [scan.meas_counter for scan in came]
    assert all(scan.frames_lost == scan.strays == 0 for scan in went)
    no_illegal_value(heard)
    assert abs(estimated(went) - 60) < 20 < 60 - estimated(came)


def no_illegal_value(frames: CanFrames) -> None:
    database = cantools.database.load_file(Path(dbc.__file__).with_name("ars408.dbc"))
    for can_id, length, payload in zip(frames.can_id, frames.length, frames.data, strict=True):
        message = database.get_message_by_frame_id(int(can_id))
        assert length == message.length
        values = message.decode(payload[:length].tobytes(), decode_choices=False)
        for one in message.signals:
            assert one.minimum - 1e-9 <= values[one.name] <= one.maximum + 1e-9


def estimated(scans: list[RadarScan]) -> float:
    """Return the mean level that murk estimates over the last half of the scans, %."""
    estimator = Estimator("radar")
    levels = [
        estimator.estimate(
            replace(scan, stamp_ns=number * CYCLE_NS), arrival_ns=0, injected=None, dropped=0
        ).level
        for number, scan in enumerate(scans)
    ]
    return float(np.mean(levels[len(levels) // 2 :]))


def test_a_bus_that_goes_down_and_comes_back_is_passed_on_again(data: Path, tmp_path: Path) -> None:
    sent = drive(data, 2)
    write_candump(tmp_path / "sent.log", [sent])
    with candump(tmp_path / "heard.log"), Gateway(scene(), "vcan1") as gateway:
        canplayer(tmp_path / "sent.log")
        wait_until_sent(gateway, len(sent))
        subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
        wait_until(lambda: gateway.summary()["bus_down"] > 0)
        subprocess.run(["ip", "link", "set", "vcan0", "up"], check=True)
        canplayer(tmp_path / "sent.log")
        wait_until_sent(gateway, 2 * len(sent))
    assert same(heard_in(tmp_path / "heard.log"), concatenate([sent, sent]))


def test_both_ways_carry_each_frame_once(data: Path, tmp_path: Path) -> None:
    sent = drive(data, 2)
    write_candump(tmp_path / "sent.log", [sent])
    with open_bus("vcan0") as radar, candump(tmp_path / "heard.log"):
        with Gateway(scene(), "vcan1", both_ways=True) as gateway:
            canplayer(tmp_path / "sent.log")
            wait_until_sent(gateway, len(sent))
            subprocess.run(["cansend", "vcan1", "300#4100"], check=True)
            wait_until(lambda: gateway.summary()["frames_back"] == 1)
            time.sleep(0.5)
        on_vcan0 = radar.read(1.0)
    assert gateway.summary()["frames_out"] == len(sent)
    assert len(heard_in(tmp_path / "heard.log")) == len(sent) + 1
    assert len(on_vcan0) == len(sent) + 1
    assert on_vcan0.can_id[-1] == 0x300


def test_low_latency_sends_each_cluster_when_it_comes(data: Path, tmp_path: Path) -> None:
    sent = drive(data, 10)
    sent = replace(sent, stamp_ns=np.arange(len(sent)) * SLOW_NS)
    write_candump(tmp_path / "sent.log", [sent])
    wanted = scene("radar:missed:60")
    with candump(tmp_path / "heard.log"), Gateway(wanted, "vcan1", low_latency=True) as gateway:
        canplayer(tmp_path / "sent.log")
        wait_until(lambda: gateway.summary()["degraded"] == 10)
    came, went = scans(sent), scans(heard_in(tmp_path / "heard.log"))
    assert [scan.meas_counter for scan in went] == [scan.meas_counter for scan in came]
    assert all(scan.frames_lost == scan.strays == 0 for scan in went)
    assert sum(map(len, went)) < 0.95 * sum(map(len, came))
    scan_ns = 250 * SLOW_NS
    assert gateway.summary()["latency_p50_ns"] < scan_ns / 2, "a stored one is as late as it took"


def test_the_command_obeys_and_ends_with_a_whole_scan_and_silence(
    data: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_candump(tmp_path / "sent.log", [drive(data, 400)])
    monkeypatch.setattr("sys.argv", ["murk", "gateway", "vcan0", "vcan1", "--json"])
    play = ["canplayer", "-I", tmp_path / "sent.log", "-g", "1", "vcan0=can0"]

    def operate() -> None:
        wait_until(lambda: running() == ["radar"])
        time.sleep(1)
        set_level("radar", "missed", 100)
        time.sleep(2)
        os.kill(os.getpid(), signal.SIGINT)

    with candump(tmp_path / "heard.log"), subprocess.Popen(play) as player:
        operator = Thread(target=operate)
        operator.start()
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert not ended.value.code
        operator.join()
        with open_bus("vcan1") as bus:
            assert not len(bus.read(1.0))
        assert player.poll() is None, "the radar still sends"
        player.kill()
    started, summary = map(json.loads, capsys.readouterr().out.splitlines())
    assert (started["type"], summary["type"]) == ("started", "summary")
    assert summary["degraded"] > 5
    heard = scans(heard_in(tmp_path / "heard.log"))
    assert len(heard[-1]) < len(heard[0])
    assert all(scan.frames_lost == 0 for scan in heard[1:]), summary


@pytest.fixture
def loop() -> Iterator[None]:
    """One vivid device whose output /dev/video1 is looped to its input /dev/video0."""
    module = ["modprobe", "-d", os.environ["MURK_VM_MODULES"], "vivid"]
    subprocess.run(["rmmod", "vivid"], check=True)
    hdmi = ["num_inputs=1", "input_types=0x3", "num_outputs=1", "output_types=0x1"]
    subprocess.run([*module, "n_devs=1", "node_types=0x101", *hdmi], check=True)
    subprocess.run(["v4l2-ctl", "-d", "/dev/video0", "-c", "loop_video=1"], check=True)
    yield
    subprocess.run(["rmmod", "vivid"], check=True)
    webcams = ["n_devs=2", "node_types=0x1,0x1", "num_inputs=1,1", "input_types=0x0,0x0"]
    subprocess.run([*module, *webcams], check=True)


@pytest.mark.usefixtures("loop")
def test_frames_reach_whoever_watches_the_output_device(tmp_path: Path) -> None:
    half = np.zeros((720, 1280, 3), np.uint8)
    half[:, :640] = 200
    for number in range(100):
        assert cv2.imwrite(str(tmp_path / f"{number:03}.png"), half)
    wanted = build_gateway_scene(None, "camera", str(tmp_path), inject=["camera:blur:100"])
    with Gateway(wanted, "/dev/video1") as gateway:
        wait_until_sent(gateway, 3)
        size = "--set-fmt-video=width=1280,height=720,pixelformat=BGR3"
        stream = ["--stream-mmap", "--stream-count=3", f"--stream-to={tmp_path / 'seen'}"]
        subprocess.run(["v4l2-ctl", "-d", "/dev/video0", size, *stream], check=True)
    seen = np.frombuffer((tmp_path / "seen").read_bytes(), np.uint8).reshape(-1, 720, 1280, 3)[-1]
    limited_range = 16
    assert seen[:, :500].mean() == pytest.approx(200, abs=limited_range)
    assert seen[:, 780:].mean() == pytest.approx(0, abs=limited_range)
    between = (seen[360, :, 1] > 40) & (seen[360, :, 1] < 160)
    assert between.sum() > 4


@pytest.fixture
def soft_squares() -> Iterator[None]:
    """Coloured squares before the camera that clip nowhere: full bars look over-exposed."""
    command = ["v4l2-ctl", "-d", "/dev/video0", "-c"]
    subprocess.run([*command, "test_pattern=4,contrast=80,saturation=60"], check=True)
    yield
    subprocess.run([*command, "test_pattern=0,contrast=128,saturation=128"], check=True)


@pytest.mark.usefixtures("soft_squares")
def test_a_blurred_camera_looks_blurred_to_murk(tmp_path: Path) -> None:
    pipe = tmp_path / "frames"
    wanted = build_gateway_scene(None, "camera", "/dev/video0", inject=["camera:blur:50"])
    # The gateway ends before the reader does: one that goes first is its failure.
    with ExitStack() as after, Gateway(wanted, f"pipe:{pipe}"):
        data = after.enter_context(pipe.open("rb")).read(5 * 640 * 480 * 3)
    for number, image in enumerate(np.frombuffer(data, np.uint8).reshape(5, 480, 640, 3)):
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    murk = [sys.executable, "-c", "from node.cli import main; main()"]
    second = subprocess.run(
        [*murk, "estimate", *map(str, sorted(tmp_path.glob("*.png"))), "--json"],
        stdout=subprocess.PIPE,
        check=True,
    )
    answers = [json.loads(line) for line in second.stdout.splitlines()]
    assert [answer["kind"] for answer in answers] == ["blur"] * 5
    assert np.mean([answer["level"] for answer in answers]) == pytest.approx(50, abs=15)
