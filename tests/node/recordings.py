"""What the tests of MCAP record: scans, frames and levels as a node publishes them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from drivers.frame import Frame
from drivers.scan import RadarScan
from models.estimate.level import CAMERA_KINDS, RADAR_KINDS, NoiseLevel
from node.bus.in_process import Bus
from node.bus.mcap import McapRecorder
from node.plan import Plan, plan
from node.scene import check_scene
from tests.drivers.radar_strategies import random_scan

START_NS = 1_700_000_000_000_000_000
SENSORS = ({"name": "front", "type": "radar", "source": "world"},
           {"name": "camera", "type": "camera", "source": "world"})  # fmt: skip


def scene_plan(path: Path, **more: Any) -> Plan:
    """Return the plan of a scene with a radar ``front`` and a ``camera`` that records all."""
    record = {"path": path, "images": True, **more.pop("record", {})}
    content = {"name": "test", "sensors": SENSORS, "outputs": {"record": record}, **more}
    return plan(check_scene(content, "test"))


def scan(sequence: int, clusters: int = 20) -> RadarScan:
    return random_scan(
        np.random.default_rng(sequence), clusters, "cluster", [sequence % 2 == 0],
        sensor="front", sequence=sequence, stamp_ns=START_NS + sequence * 72_000_000,
        meas_counter=sequence, stamp_source="kernel",
    )  # fmt: skip


def frame(sequence: int) -> Frame:
    image = np.random.default_rng(sequence).integers(0, 256, (24, 32, 3), dtype=np.uint8)
    return Frame(image, "camera", sequence, START_NS + sequence * 40_000_000 + 1, "device")


def level(message: RadarScan | Frame, injected: dict[str, float] | None = None) -> NoiseLevel:
    kinds = CAMERA_KINDS if isinstance(message, Frame) else RADAR_KINDS
    return NoiseLevel(
        sensor=message.sensor, stamp_ns=message.stamp_ns, level=10 / 3, std=np.pi,
        probabilities=np.random.default_rng(message.sequence).dirichlet(np.ones(11)),
        kind=kinds[1], kind_probabilities=dict.fromkeys(kinds, 1 / len(kinds)),
        raw=2 / 3, injected=injected, latency_ns=12345, sequence=message.sequence, dropped=3,
    )  # fmt: skip


def published(count: int, injected: dict[str, float] | None = None) -> Iterator[tuple[str, Any]]:
    """Yield topics and messages of so many scans and frames, each with its level."""
    for sequence in range(count):
        for name, message in (("front/scan", scan(sequence)), ("camera/image", frame(sequence))):
            yield f"/murk/{name}", message
            yield f"/murk/{message.sensor}/noise_level", level(message, injected)


def record(made: Plan, messages: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Publish messages to a recorder, close it, and return its counts."""
    with Bus() as bus:
        recorder = McapRecorder(made, bus)
        for topic, message in messages:
            bus.publish(topic, message)
        recorder.close()
        return recorder.counts()
