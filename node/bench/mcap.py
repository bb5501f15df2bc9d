"""What recording to MCAP costs, and how soon a message can be read from the file.

The rig of nuScenes is published in real time: five radars at 14 Hz, each scan with its noise level,
and the levels of six cameras at 12 Hz, without and with their images of 1600×900 pixels. A run
time is CPU time a message of the thread that records, an error the messages that were dropped. A
latency is from publishing a level until it can be read from the file.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread
from typing import Any, NamedTuple

import cv2
import numpy as np

from drivers.frame import Frame
from drivers.scan import RadarScan
from models.estimate.level import CAMERA_KINDS, LEVELS, RADAR_KINDS, NoiseLevel
from models.evaluate.report import Goal, Point
from models.world.camera import WorldCamera
from models.world.radar import WorldRadar
from models.world.road import World
from node.bus.in_process import Bus
from node.bus.mcap import McapRecorder
from node.bus.mcap_reader import McapRecording
from node.plan import Plan, plan
from node.scene import check_scene

RADARS, RADAR_HZ = 5, 14.0
CAMERAS, CAMERA_HZ = 6, 12.0
SIZE = (1600, 900)
SEEN_S = 1.0
"""How long the simulated sensors look; what they saw is published again and again."""
RUN_S, QUICK_S = 20.0, 3.0
POLL_S = 0.01
SETTLED_S = 1.0
SHARE_GOAL = 5.0
"""Of a core, %: what levels and scans of the rig may take."""


class Measured(NamedTuple):
    """What a recording cost: CPU time (s), the recorder's counts, latencies of levels (ns)."""

    cpu_s: float
    counts: dict[str, Any]
    latencies_ns: list[int]


def run(quick: bool) -> Iterator[Point | Goal]:
    """Measure cost and drops of the rig with and without images, and the latency."""
    duration_s = QUICK_S if quick else RUN_S
    small = _record(list(_schedule(duration_s, images=False)))
    large = _record(list(_schedule(duration_s, images=True)))
    for what, one in (("levels and scans", small), ("levels, scans and images", large)):
        cost_us = 1e6 * one.cpu_s / one.counts["messages"]
        knob = f"{one.counts['messages'] / duration_s:.0f} messages/s"
        yield Point(f"MCAP, {what}", knob, cost_us, one.counts["dropped"], "messages dropped")
    lost = sum(topic.endswith("noise_level") for _, topic, _ in _schedule(duration_s, images=False))
    lost -= len(small.latencies_ns)
    for percentile in (50, 99):
        latency_us = float(np.percentile(small.latencies_ns, percentile)) / 1e3
        yield Point("latency, into MCAP", f"p{percentile}", latency_us, lost, "levels lost")
    share = 100 * small.cpu_s / duration_s
    yield Goal("MCAP, levels and scans of the rig, share of a core, %", share, SHARE_GOAL, False)
    yield Goal("MCAP, messages of the rig dropped", small.counts["dropped"], 0, at_least=False)


def _schedule(duration_s: float, *, images: bool) -> Iterator[tuple[float, str, Any]]:
    """Yield when each message of the rig is due (s), its topic, and the message, in order."""
    world = World(seed=1, duration_s=SEEN_S)
    radar, camera = WorldRadar(world), WorldCamera(world)
    scans = [radar.scan(number) for number in range(int(SEEN_S * RADAR_HZ))]
    frames = [camera.frame(number) for number in range(int(SEEN_S * CAMERA_HZ))]
    frames = [replace(one, image=_enlarged(one)) for one in frames] if images else frames
    due: list[tuple[float, int, Frame | RadarScan]] = []
    for number in range(int(duration_s * RADAR_HZ)):
        due += [
            ((number + sensor / RADARS) / RADAR_HZ, number,
             replace(scans[number % len(scans)], sensor=f"radar_{sensor}"))
            for sensor in range(RADARS)
        ]  # fmt: skip
    for number in range(int(duration_s * CAMERA_HZ)):
        due += [
            ((number + sensor / CAMERAS) / CAMERA_HZ, number,
             replace(frames[number % len(frames)], sensor=f"camera_{sensor}"))
            for sensor in range(CAMERAS)
        ]  # fmt: skip
    for due_s, number, message in sorted(due, key=lambda one: one[0]):
        is_frame = isinstance(message, Frame)
        if images or not is_frame:
            topic = "image" if is_frame else "scan"
            yield due_s, f"/murk/{message.sensor}/{topic}", replace(message, sequence=number)
        yield due_s, f"/murk/{message.sensor}/noise_level", _level(message, number)


def _enlarged(frame: Frame) -> Any:
    return cv2.resize(frame.image, SIZE, interpolation=cv2.INTER_CUBIC)


def _level(message: Frame | RadarScan, sequence: int) -> NoiseLevel:
    kinds = CAMERA_KINDS if isinstance(message, Frame) else RADAR_KINDS
    probabilities = np.exp(-(((LEVELS - 10.0) / 15.0) ** 2))
    return NoiseLevel(
        sensor=message.sensor,
        stamp_ns=message.stamp_ns,
        level=10.0 + sequence % 7 / 7,
        std=5.0,
        probabilities=probabilities / probabilities.sum(),
        kind=kinds[0],
        kind_probabilities=dict.fromkeys(kinds, 1 / len(kinds)),
        raw=12.0,
        injected=None,
        latency_ns=5_000_000 + sequence,
        sequence=sequence,
        dropped=0,
    )


def _record(schedule: list[tuple[float, str, Any]]) -> Measured:
    """Publish a schedule to a recorder in real time."""
    latencies_ns: list[int] = []
    ended = Event()
    images = any(topic.endswith("image") for _, topic, _ in schedule)
    with TemporaryDirectory() as folder, Bus() as bus, _silenced("murk.recording"):
        path = Path(folder) / "rig.mcap"
        recorder = McapRecorder(_plan(path, images), bus)
        (thread,) = (one for one in threading.enumerate() if one.name == "murk-record")
        clock = time.pthread_getcpuclockid(thread.ident or 0)
        reader = Thread(target=_read, args=(path, latencies_ns, ended))
        if not images:
            reader.start()
        start_s = time.monotonic()
        for due_s, topic, message in schedule:
            time.sleep(max(0.0, start_s + due_s - time.monotonic()))
            bus.publish(topic, message)
        _settle(recorder)
        cpu_s = time.clock_gettime(clock)
        recorder.close()
        if not images:
            ended.set()
            reader.join()
        return Measured(cpu_s, recorder.counts(), latencies_ns)


def _settle(recorder: McapRecorder) -> None:
    """Wait until nothing more is written."""
    before = -1
    while before != (written := recorder.counts()["messages"]):
        before = written
        time.sleep(SETTLED_S)


def _plan(path: Path, images: bool) -> Plan:
    names = [("radar", n) for n in range(RADARS)] + [("camera", n) for n in range(CAMERAS)]
    sensors = [{"name": f"{kind}_{n}", "type": kind, "source": "world"} for kind, n in names]
    record = {"path": path, "images": images}
    return plan(check_scene({"sensors": sensors, "outputs": {"record": record}}, "bench"))


def _read(path: Path, latencies_ns: list[int], ended: Event) -> None:
    """Read the file whenever it has grown, and note how old each new level is."""
    recording = McapRecording((path,), {}, {})
    names = [f"radar_{n}" for n in range(RADARS)] + [f"camera_{n}" for n in range(CAMERAS)]
    topics = {f"/murk/{name}/noise_level" for name in names}
    size = 0
    while not ended.wait(POLL_S):
        if path.stat().st_size == size:
            continue
        size = path.stat().st_size
        seen = [entry.log_time for entry in recording.entries(topics)]
        now_ns = time.time_ns()
        latencies_ns += [now_ns - one for one in seen[len(latencies_ns) :]]


@contextmanager
def _silenced(logger: str) -> Iterator[None]:
    """Log no warnings: the file is read while it is written, so that it always ends early."""
    log = logging.getLogger(logger)
    before = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(before)
