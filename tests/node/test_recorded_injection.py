from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from drivers.frame import Frame
from drivers.scan import RadarScan
from models.degrade.kinds import module_of
from node.bus.in_process import Bus
from node.bus.mcap import McapRecorder
from node.bus.mcap_reader import McapRecording, open_mcap
from node.pipeline import Pipeline
from node.plan import plan
from node.recording import decode
from node.scene import check_scene

RADAR = {"name": "front", "type": "radar", "source": "world"}
INJECTIONS = (
    {"sensor": "camera", "kind": "rain", "shape": "walk", "level": 60, "spread": 20},
    {"sensor": "camera", "kind": "noise", "level": 35},
    {"sensor": "front", "kind": "snr", "shape": "walk", "level": 70, "spread": 20},
    {"sensor": "front", "kind": "multipath", "level": 100},
)


@pytest.fixture
def camera(tmp_path: Path) -> dict[str, Any]:
    random = np.random.default_rng(1)
    for number in range(8):
        image = random.integers(0, 256, (45, 80, 3), dtype=np.uint8)
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    return {"name": "camera", "type": "camera", "source": str(tmp_path)}


def recorded(path: Path, *sensors: dict[str, Any], **content: Any) -> McapRecording:
    content |= {"sensors": sensors, "outputs": {"record": {"path": path, "images": True}}}
    made = plan(check_scene({**content, "clock": {"fast": True}, "duration_s": 1.0}, "test"))
    with Bus() as bus:
        recorder = McapRecorder(made, bus)
        for _ in Pipeline(made, bus).run():
            pass
        recorder.close()
        assert recorder.counts()["dropped"] == 0
    return open_mcap(path)


def by_sequence(recording: McapRecording, topic: str) -> dict[int, Any]:
    """Return the messages of a topic; of ``image`` and ``scan`` what lies beside is needed."""
    messages, info = {}, None
    for entry in recording.entries({topic, f"{topic}_info"}):
        if entry.topic == topic:
            message = decode(entry, info, len(messages), Path("recording"))
            messages[message.sequence] = message
        else:
            info = entry.cdr
    return messages


@pytest.mark.parametrize("name", ["camera", "front"])
def test_a_recording_is_enough_to_degrade_the_same_messages_again(
    camera: dict[str, Any], tmp_path: Path, name: str
) -> None:
    """To the bit, by the drawn parameters alone: neither seed nor schedule nor order is asked."""
    sensor_type = "camera" if name == "camera" else "radar"
    topic = "/murk/camera/image" if name == "camera" else "/murk/front/scan"
    clean = recorded(tmp_path / "clean.mcap", camera, RADAR)
    noisy = recorded(tmp_path / "noisy.mcap", camera, RADAR, injections=INJECTIONS)
    levels = by_sequence(noisy, f"/murk/{name}/noise_level")
    degraded, originals = by_sequence(noisy, topic), by_sequence(clean, topic)
    assert set(degraded) == set(originals) == set(levels)
    assert len(degraded) >= 6
    for sequence, original in originals.items():
        level = levels[sequence]
        assert list(level.drawn) == [one["kind"] for one in INJECTIONS if one["sensor"] == name]
        assert {kind: one.level for kind, one in level.drawn.items()} == level.injected
        data = original.image if name == "camera" else original
        for kind, drawn in level.drawn.items():
            data = module_of(sensor_type, kind).apply(drawn, data)
        assert is_same(degraded[sequence], data)
        assert not is_same(degraded[sequence], original)


def test_nobody_hears_of_it_where_nothing_was_injected(
    camera: dict[str, Any], tmp_path: Path
) -> None:
    recording = recorded(tmp_path / "clean.mcap", camera)
    levels = by_sequence(recording, "/murk/camera/noise_level").values()
    assert [level.drawn for level in levels] == [None] * 8


def pixels_or_points(message: Any) -> dict[str, Any]:
    if isinstance(message, RadarScan):
        return message.arrays()
    return {"image": message.image if isinstance(message, Frame) else message}


def is_same(one: Any, other: Any) -> bool:
    first, second = pixels_or_points(one), pixels_or_points(other)
    return first.keys() == second.keys() and all(
        np.array_equal(first[name], second[name]) for name in first
    )
