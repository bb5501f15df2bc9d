"""Scans to frames: the inverse of the assembler."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from radar_strategies import comparable, random_scan, scans_of

from dbc.errors import InputError
from drivers.ars408 import ScanAssembler
from drivers.can_frames import concatenate
from drivers.candump import read_candump
from drivers.encode import encode_motion, encode_scan, encode_state
from drivers.scan import MotionInput, RadarScan, RadarState

GRID_STEP = {"x": 0.2, "y": 0.2, "vx": 0.25, "vy": 0.25, "rcs": 0.5}


@given(
    n=st.integers(1, 250),
    seed=st.integers(0, 2**32),
    mode=st.sampled_from(["cluster", "object"]),
    lists=st.tuples(st.booleans(), st.booleans()),
    sensor_id=st.integers(0, 7),
    meas_counter=st.integers(0, 65535),
    stamp_ns=st.integers(0, 2**62),
    spacing_ns=st.none() | st.integers(0, 10**6),
)
@settings(max_examples=80, deadline=None)
def test_decoding_undoes_encoding(
    n: int,
    seed: int,
    mode: str,
    lists: tuple[bool, bool],
    sensor_id: int,
    meas_counter: int,
    stamp_ns: int,
    spacing_ns: int | None,
) -> None:
    scan = random_scan(
        np.random.default_rng(seed),
        n,
        mode,
        lists,
        sensor=f"radar_{sensor_id}",
        sensor_id=sensor_id,
        meas_counter=meas_counter,
        stamp_ns=stamp_ns,
    )
    (found,) = scans_of([encode_scan(scan, spacing_ns)])
    assert comparable(found) == comparable(scan)


@given(st.integers(0, 2**32), st.floats(-0.49, 0.49))
@settings(max_examples=30, deadline=None)
def test_values_are_rounded_to_the_can_grid(seed: int, part: float) -> None:
    scan = random_scan(np.random.default_rng(seed), 20, "cluster", [True])
    moved = replace(
        scan,
        **{
            name: (getattr(scan, name) + part * step).astype(np.float32)
            for name, step in GRID_STEP.items()
        },
    )
    (found,) = scans_of([encode_scan(moved)])
    assert comparable(found) == comparable(scan)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("x", 1138.4, r"Cluster_1_General\.Cluster_DistLong: 1138\.4 is out of range; -500 to"),
        ("vx", np.nan, r"Cluster_VrelLong: nan is out of range"),
        ("rcs", np.inf, r"Cluster_RCS: inf is out of range"),
    ],
)
def test_a_value_that_does_not_fit_is_refused(field: str, value: float, message: str) -> None:
    scan = random_scan(np.random.default_rng(0), 3, "cluster", [True])
    column = getattr(scan, field).copy()
    column[1] = value
    with pytest.raises(InputError, match=message):
        encode_scan(replace(scan, **{field: column}))


def test_counts_that_do_not_fit_and_half_a_list_are_refused() -> None:
    scan = random_scan(np.random.default_rng(0), 3, "cluster", [True])
    with pytest.raises(InputError, match="Cluster_NofClustersNear: 256 is out of range; 0 to 255"):
        encode_scan(replace(scan, near=256))
    with pytest.raises(InputError, match="scan 0 of radar_0: has no pdh0"):
        encode_scan(replace(scan, pdh0=None))


def test_frames_are_back_to_back_at_500_kbit_s_or_as_told() -> None:
    scan = random_scan(np.random.default_rng(0), 2, "cluster", [True], stamp_ns=10**9, sensor_id=3)
    frames = encode_scan(scan)
    assert frames.can_id.tolist() == [0x630, 0x731, 0x731, 0x732, 0x732]
    assert frames.length.tolist() == [5, 8, 8, 5, 5]
    bits = [111, 111, 87, 87]
    assert np.diff(frames.stamp_ns).tolist() == [2000 * bit for bit in bits]
    assert frames.stamp_ns[0] == 10**9
    assert np.diff(encode_scan(scan, 250_000).stamp_ns).tolist() == [250_000] * 4


def test_a_scan_that_lost_frames_is_sent_as_one_that_loses_them() -> None:
    scan = random_scan(np.random.default_rng(0), 5, "cluster", [True], near=4, far=3)
    (found,) = scans_of([encode_scan(scan)])
    assert (found.near, found.far, len(found), found.frames_lost) == (4, 3, 5, 4)


@given(st.integers(-8191, 8191), st.integers(-32768, 32767), st.integers(0, 7))
@settings(max_examples=50, deadline=None)
def test_motion_round_trip(speed: int, yaw_rate: int, sensor_id: int) -> None:
    frames = encode_motion(0.02 * speed, 0.01 * yaw_rate, 5, sensor_id)
    assert frames.can_id.tolist() == [0x300 + 16 * sensor_id, 0x301 + 16 * sensor_id]
    assert frames.data[0, 0] >> 6 == (0 if speed == 0 else 1 if speed > 0 else 2)
    found = ScanAssembler().feed(frames)[-1]
    assert isinstance(found, MotionInput)
    assert found.speed == pytest.approx(0.02 * speed)
    assert found.yaw_rate == pytest.approx(0.01 * yaw_rate)


@pytest.mark.parametrize(
    ("speed", "yaw_rate", "signal"), [(164, 0, "Speed"), (-164, 0, "Speed"), (0, 328, "YawRate")]
)
def test_motion_out_of_range_is_refused(speed: float, yaw_rate: float, signal: str) -> None:
    with pytest.raises(InputError, match=f"RadarDevice_{signal}"):
        encode_motion(speed, yaw_rate)


def test_state_round_trip() -> None:
    values = {"RadarState_MaxDistanceCfg": 250.0, "RadarState_SendQualityCfg": 1.0}
    (found,) = ScanAssembler({2: "front"}).feed(encode_state(RadarState("front", 2, 7, values)))
    assert isinstance(found, RadarState)
    assert (found.sensor, found.sensor_id, found.stamp_ns) == ("front", 2, 7)
    assert {name: value for name, value in found.values.items() if value} == values
    with pytest.raises(InputError, match=r"RadarState\.Speed: is not a signal"):
        encode_state(RadarState("front", 2, 7, {"Speed": 1.0}))


@pytest.mark.parametrize("name", ["candump/object_mode_144s.log", "nuscenes_mini/scene-0553.log"])
def test_real_recordings_come_back_to_the_byte(data: Path, name: str) -> None:
    recorded = concatenate(list(read_candump(data / "radar" / name)))
    listed = np.isin(recorded.can_id, [0x600, 0x701, 0x702, 0x60A, 0x60B, 0x60C, 0x60D])
    recorded = recorded.select(listed)
    scans = scans_of([recorded])
    assert all(isinstance(scan, RadarScan) for scan in scans)
    encoded = concatenate([encode_scan(scan) for scan in scans])
    np.testing.assert_array_equal(encoded.can_id, recorded.can_id)
    np.testing.assert_array_equal(encoded.length, recorded.length)
    np.testing.assert_array_equal(encoded.data, recorded.data)
