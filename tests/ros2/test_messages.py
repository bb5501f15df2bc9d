"""ROS messages: what goes in comes out, and bytes that are none are refused in one line."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from dbc.errors import InputError
from drivers.frame import Frame
from drivers.scan import RadarScan
from models.estimate.level import NoiseLevel
from node.bus.messages import (
    PACKAGE,
    InjectionRequest,
    deserialize,
    from_ros,
    info_to_ros,
    to_ros,
    type_name_of,
    typestore,
)
from node.events import ModelChoice, NodeEvent, NodeState
from node.health import SensorEvent
from tests.drivers.radar_strategies import random_scan

STAMPS = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
COUNTS = st.integers(0, 2**63)
WORDS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=20)
FLOATS = st.floats(allow_nan=False)
LEVELS_BY_KIND = st.dictionaries(WORDS, FLOATS, max_size=5)


@st.composite
def noise_levels(draw: st.DrawFn) -> NoiseLevel:
    return NoiseLevel(
        sensor=draw(WORDS),
        stamp_ns=draw(STAMPS),
        level=draw(FLOATS),
        std=draw(FLOATS),
        probabilities=np.array(draw(st.lists(FLOATS, min_size=11, max_size=11))),
        kind=draw(WORDS),
        kind_probabilities=draw(LEVELS_BY_KIND),
        raw=draw(FLOATS),
        effort=draw(FLOATS),
        injected=draw(LEVELS_BY_KIND) or None,
        latency_ns=draw(st.integers(-(2**63), 2**63 - 1)),
        sequence=draw(COUNTS),
        dropped=draw(COUNTS),
    )


SMALL_MESSAGES = st.one_of(
    st.builds(SensorEvent, WORDS, STAMPS, st.sampled_from(["ok", "stale", "lost"]), WORDS),
    st.builds(ModelChoice, WORDS, STAMPS, WORDS, WORDS, WORDS),
    st.builds(NodeState, WORDS, STAMPS, st.sampled_from(["active", "finalized"]), COUNTS),
    st.builds(NodeEvent, WORDS, STAMPS, WORDS),
    st.builds(InjectionRequest, WORDS, st.none() | FLOATS),
)


INJECTED = LEVELS_BY_KIND.map(lambda levels: levels or None)


def assert_same(one: Any, other: Any) -> None:
    assert type(one) is type(other)
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype
            assert a.shape == b.shape
            assert a.tobytes() == b.tobytes()
        else:
            assert a == b, field.name


def returned(message: Any, *, lossless: bool = False) -> Any:
    store = typestore()
    ros = to_ros(message, store, lossless=lossless)
    assert ros.type_name == type_name_of(type(message))
    beside = isinstance(message, RadarScan | Frame)
    info = info_to_ros(message, store).cdr if beside else None
    return from_ros(ros.type_name, ros.cdr, store, info)


@given(noise_levels())
def test_noise_level_returns(level: NoiseLevel) -> None:
    assert_same(level, returned(level))


@given(SMALL_MESSAGES)
def test_small_messages_return(message: Any) -> None:
    assert returned(message) == message


@given(
    st.integers(0, 1000),
    st.integers(0, 250),
    st.sampled_from(["cluster", "object"]),
    st.tuples(st.booleans(), st.booleans()),
    st.tuples(STAMPS, st.integers(0, 7), st.integers(0, 65535)),
    st.lists(COUNTS, min_size=6, max_size=6),
    INJECTED,
)
def test_scan_returns_bit_for_bit(
    seed: int,
    n: int,
    mode: str,
    lists: tuple[bool, bool],
    head: Any,
    counts: list[int],
    injected: dict[str, float] | None,
) -> None:
    stamp_ns, sensor_id, meas_counter = head
    names = ("sequence", "frames_lost", "cycles_lost", "duplicates", "strays", "dropped")
    scan = random_scan(
        np.random.default_rng(seed),
        n,
        mode,
        lists,
        stamp_ns=stamp_ns,
        sensor_id=sensor_id,
        meas_counter=meas_counter,
        injected=injected,
        **dict(zip(names, counts, strict=True)),
    )
    assert_same(scan, returned(scan))


def test_the_cloud_is_one_that_ros_displays() -> None:
    scan = random_scan(np.random.default_rng(1), 9, "cluster", [True])
    store = typestore()
    ros = to_ros(scan, store)
    cloud: Any = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr(ros.cdr, ros.type_name)
    assert [field.name for field in cloud.fields[:3]] == ["x", "y", "z"]
    assert {"vx", "vy", "rcs", "dyn_prop", "pdh0", "ambig_state", "invalid_state", "x_rms"} <= {
        field.name for field in cloud.fields
    }
    assert (cloud.height, cloud.width) == (1, 9)
    assert len(cloud.data) == cloud.row_step == 9 * cloud.point_step


def frame(height: int, width: int, seed: int = 0) -> Frame:
    image = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    return Frame(image, "front", 7, 123_456_789_012, "kernel", 3)


@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 100), INJECTED)
def test_frame_returns_from_png_bit_for_bit(
    height: int, width: int, seed: int, injected: dict[str, float] | None
) -> None:
    one = replace(frame(height, width, seed), injected=injected)
    assert_same(one, returned(one, lossless=True))


def test_frame_returns_from_jpeg_nearly() -> None:
    smooth = np.repeat(np.arange(64, dtype=np.uint8)[:, None] * 3, 64, axis=1)
    one = Frame(np.dstack([smooth] * 3), "front", 7, 5, "file")
    other = returned(one)
    assert np.abs(other.image.astype(int) - one.image).max() <= 8
    assert (other.sensor, other.sequence, other.stamp_ns) == ("front", 7, 5)


@given(noise_levels(), st.data())
def test_truncated_bytes_are_refused(level: NoiseLevel, data: st.DataObject) -> None:
    name, cdr = to_ros(level, typestore())
    cut = data.draw(st.integers(0, len(cdr) - 9))
    with pytest.raises(InputError):
        from_ros(name, cdr[:cut], typestore())


@given(st.binary(max_size=200))
def test_random_bytes_are_refused_or_read(junk: bytes) -> None:
    for name in ("murk_msgs/msg/Injection", "murk_msgs/msg/NoiseLevel"):
        with suppress(InputError):
            assert from_ros(name, junk, typestore()) is not None


def test_unknown_type_and_missing_info_are_refused() -> None:
    with pytest.raises(InputError, match="no message of murk's"):
        from_ros("std_msgs/msg/String", b"", typestore())
    ros = to_ros(frame(2, 2), typestore())
    with pytest.raises(InputError, match="beside"):
        from_ros(ros.type_name, ros.cdr, typestore())


def test_a_cloud_of_somebody_else_is_refused() -> None:
    scan = random_scan(np.random.default_rng(1), 3, "cluster", [])
    store = typestore()
    ros, info = to_ros(scan, store), info_to_ros(scan, store)
    cloud: Any = deserialize(ros.type_name, ros.cdr, store)
    cloud.fields[0].name = "distance"
    changed = bytes(store.serialize_cdr(cloud, ros.type_name))
    with pytest.raises(InputError, match="malformed"):
        from_ros(ros.type_name, changed, store, info.cdr)


def test_package_lists_every_message_and_each_says_its_units() -> None:
    listed = (PACKAGE / "CMakeLists.txt").read_text(encoding="utf-8")
    paths: list[Path] = sorted(PACKAGE.glob("msg/*.msg"))
    assert len(paths) >= 8
    for path in paths:
        assert f'"msg/{path.name}"' in listed
        assert f"murk_msgs/msg/{path.stem}" in typestore().types
