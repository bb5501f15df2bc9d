"""Levels from any carrier are those that were published, and silence is told, whatever it is."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import pytest

from dbc.errors import InputError
from models.estimate.level import NoiseLevel
from node.bus.can import CanOutput
from node.bus.in_process import Bus
from node.pipeline import Pipeline
from node.plan import Plan, plan
from node.scene import check_scene
from node.subscribe import BusLevels, subscribe
from tests.node.switching import noise_level

TOPIC = "/murk/{}/noise_level"
PATIENCE_S = 20.0


def a_plan(**outputs: object) -> Plan:
    sensors = [{"name": name, "type": name, "source": "world"} for name in ("camera", "radar")]
    content = {
        "sensors": sensors[1:] if "record" in outputs else sensors,
        "outputs": outputs,
        "clock": {"fast": True},
        "duration_s": 1.0,
    }
    return plan(check_scene(content, "test"))


def first(levels: Iterator[NoiseLevel | None]) -> NoiseLevel:
    deadline_s = time.monotonic() + PATIENCE_S
    for level in levels:
        assert time.monotonic() < deadline_s
        if level is not None:
            return level
    raise AssertionError("they ended")


def test_a_bus_yields_levels_and_lets_time_pass() -> None:
    with Bus() as bus:
        levels = subscribe(bus, ["camera", "radar"])
        bus.publish(TOPIC.format("camera"), one := noise_level("camera", 1))
        bus.publish(TOPIC.format("radar"), other := noise_level("radar", 2))
        bus.publish(TOPIC.format("rear"), noise_level("rear", 3))
        assert [next(levels) for _ in range(3)] == [one, other, None]
        bus.publish(TOPIC.format("radar"), other)
    assert list(levels) == [other]


def test_who_is_slow_loses_the_oldest_and_counts() -> None:
    with Bus() as bus:
        levels = BusLevels(bus, ["camera"])
        for number in range(8):
            bus.publish(TOPIC.format("camera"), noise_level("camera", number))
        levels.close()
        assert [level.level for level in levels if level] == [3, 4, 5, 6, 7]
        assert levels.dropped == 3


def test_can_yields_a_level_once_however_often_it_is_repeated() -> None:
    channel = f"virtual:{uuid4()}"
    with Bus() as bus:
        levels = subscribe(f"can:{channel}", ["camera", "radar"])
        output = CanOutput(a_plan(can={"bus": channel}), bus)
        bus.publish(TOPIC.format("radar"), noise_level("radar", 62.5))
        level = first(levels)
        assert (level.sensor, level.level, level.std) == ("radar", 62.5, 1.0)
        end_s = time.monotonic() + 0.4  # three repetitions, as long as nobody holds this thread
        while time.monotonic() < end_s:
            assert next(levels) is None
        assert output.counts()["sent"] > 4
        bus.publish(TOPIC.format("camera"), noise_level("camera", 10))
        assert first(levels).sensor == "camera"
        output.close()


def test_ros2_yields_what_was_published_to_the_last_joiner() -> None:
    pytest.importorskip("cyclonedds", reason="needs the extra 'ros2'")
    from node.bus.dds import LATCHED, RosParticipant
    from node.bus.messages import to_ros, typestore

    participant = RosParticipant(92, network=False)
    message = to_ros(noise_level("camera", 62.5, stamp_ns=5), typestore())
    writer = participant.writer("/car/murk/camera/noise_level", message.type_name, LATCHED)
    writer.write(message.cdr)
    levels = subscribe("ros2:92/car", ["radar", "camera"])
    level = first(levels)
    assert (level.sensor, level.stamp_ns, level.level) == ("camera", 5, 62.5)
    assert next(levels) is None


def test_a_recording_yields_its_levels_in_order(tmp_path: Path) -> None:
    from node.bus.mcap import McapRecorder

    path = tmp_path / "drive.mcap"
    kept = a_plan(record={"path": path})
    with Bus() as bus:
        pipeline = Pipeline(kept, bus)
        recorder = McapRecorder(kept, bus)
        published = [(level.stamp_ns, level.level) for level in pipeline.run()]
        recorder.close()
    read = [(level.stamp_ns, level.level) for level in subscribe(str(path), ["radar"]) if level]
    assert published
    assert read == published


@pytest.mark.parametrize(
    "source", ["smoke:signals", "can:", "ros2:x", "ros2:233", "missing.mcap", "can:nothing:0"]
)
def test_what_is_no_carrier_is_refused_at_once(source: str) -> None:
    with pytest.raises(InputError):
        subscribe(source, ["camera"])
