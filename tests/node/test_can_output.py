"""Levels on CAN: what an ECU reads is what was published, and what is wrong does not get by."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import cantools
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

import dbc
from dbc.codec import noise_level
from dbc.errors import SceneError
from models.degrade.kinds import KINDS
from models.estimate.level import CAMERA_KINDS, RADAR_KINDS
from node.bus.can import CanOutput
from node.bus.can_levels import CanLevel, LevelReader, encode_level
from node.bus.in_process import Bus
from node.events import EVENT_TOPIC
from node.health import SensorEvent
from node.pipeline import Pipeline
from node.plan import Plan, plan
from node.scene import check_scene

DBC = Path(str(dbc.__path__[0])) / "noise_level.dbc"

percents = st.integers(0, 200).map(lambda half: half / 2)
levels = st.builds(
    CanLevel,
    can_id=st.integers(0, 0x7FF),
    stamp_ns=st.just(0),
    sensor_type=st.sampled_from(["camera", "radar"]),
    state=st.sampled_from(["never_seen", "ok", "stale", "lost"]),
    level=percents,
    std=percents,
    kind=st.sampled_from(sorted(noise_level().choices["NoiseLevel_Kind"].values())),
    kind_probability=percents.map(lambda percent: percent / 100),
    age_ms=st.integers(0, 65535),
    counter=st.integers(0, 15),
)


@pytest.fixture
def channel() -> str:
    return f"virtual:{uuid4()}"


@pytest.fixture
def reader(channel: str) -> Iterator[LevelReader]:
    with LevelReader(channel) as reader:
        yield reader


def a_plan(channel: str, *types: str) -> Plan:
    sensors = [{"name": kind, "type": kind, "source": "world"} for kind in types]
    content = {
        "sensors": sensors,
        "outputs": {"can": {"bus": channel}},
        "clock": {"fast": True},
        "duration_s": 1.0,
    }
    return plan(check_scene(content, "test"))


def test_every_kind_that_can_be_injected_or_estimated_has_a_code() -> None:
    named = set(noise_level().choices["NoiseLevel_Kind"].values())
    assert named >= {*KINDS["camera"], *KINDS["radar"], *CAMERA_KINDS, *RADAR_KINDS}


@given(levels)
def test_cantools_reads_what_was_said(level: CanLevel) -> None:
    frames = encode_level(level)
    said = cantools.database.load_file(DBC).messages[0].decode(frames.data[0].tobytes())
    assert said["NoiseLevel_Level"] == level.level
    assert said["NoiseLevel_Std"] == level.std
    assert str(said["NoiseLevel_Kind"]) == level.kind
    assert str(said["NoiseLevel_State"]) == level.state
    assert said["NoiseLevel_Age"] == level.age_ms
    assert said["NoiseLevel_Counter"] == level.counter


@given(level=levels, bit=st.integers(0, 63))
def test_a_reader_gets_the_level_back_and_no_frame_with_a_wrong_bit(
    level: CanLevel, bit: int
) -> None:
    with LevelReader("virtual:bits") as reader:
        frames = encode_level(level)
        assert list(reader.decode(frames)) == [level]
        frames.data[0, bit // 8] ^= 1 << bit % 8
        assert not list(reader.decode(frames))
        assert reader.corrupt == 1


def test_missing_frames_are_counted_by_the_rolling_counter() -> None:
    with LevelReader("virtual:counter") as reader:
        base = CanLevel(0x6F0, 0, "radar", "ok", 10.0, 1.0, "clean", 1.0, 0, 14)
        for counter in (14, 15, 0, 3):
            frame = encode_level(CanLevel(**{**_fields(base), "counter": counter}))
            list(reader.decode(frame))
        assert reader.lost == 2


def _fields(level: CanLevel) -> dict[str, object]:
    return {name: getattr(level, name) for name in CanLevel.__slots__}


def test_a_run_says_every_level_that_it_estimates(channel: str, reader: LevelReader) -> None:
    kept = a_plan(channel, "radar", "camera")
    with Bus() as bus:
        pipeline = Pipeline(kept, bus)
        output = CanOutput(kept, bus)
        last = {}
        for level in pipeline.run():
            last[level.sensor] = level
            time.sleep(0.01)
        output.close()
        assert output.counts()["failed"] == 0
    heard = {level.can_id: level for level in reader.read(1.0)}
    for number, name in enumerate(("radar", "camera")):
        said = heard[0x6F0 + number]
        assert said.sensor_type == name
        assert said.state == "ok"
        assert said.level == pytest.approx(last[name].level, abs=0.26)
        assert said.kind == last[name].kind
    assert reader.lost == 0
    assert reader.corrupt == 0


def test_silence_is_said_again_and_again_with_its_state(channel: str, reader: LevelReader) -> None:
    kept = a_plan(channel, "radar")
    with Bus() as bus:
        output = CanOutput(kept, bus)
        bus.publish("/murk/radar/event", SensorEvent("radar", 0, "lost", "unplugged"))
        heard: list[CanLevel] = []
        deadline_s = time.monotonic() + 10
        while len([one for one in heard if one.state == "lost"]) < 3:
            heard += reader.read(0.5)
            assert time.monotonic() < deadline_s
        output.close()
    assert np.diff([one.counter for one in heard]).tolist().count(1) >= 2
    assert {one.age_ms for one in heard} == {65535}


def test_a_bus_that_fails_is_counted_and_said_once(channel: str) -> None:
    kept = a_plan(channel, "radar")
    with Bus() as bus:
        output = CanOutput(kept, bus)
        output._can.listen_only = True  # as an interface that takes nothing
        deadline_s = time.monotonic() + 10
        while output.counts()["failed"] < 2:
            assert time.monotonic() < deadline_s
            time.sleep(0.01)
        assert "not sent" in bus.latest(EVENT_TOPIC).detail
        output.close()


def test_more_sensors_than_identifiers_are_refused(channel: str) -> None:
    content = {
        "sensors": [{"name": "radar", "type": "radar", "source": "world"}],
        "outputs": {"can": {"bus": channel, "first_id": 0x7FF}},
    }
    one = plan(check_scene(content, "test"))
    two = {
        **content,
        "sensors": [*content["sensors"], {"name": "b", "type": "radar", "source": "world"}],
    }
    with Bus() as bus:
        CanOutput(one, bus).close()
        with pytest.raises(SceneError, match="0x7FF"):
            CanOutput(plan(check_scene(two, "test")), bus)
