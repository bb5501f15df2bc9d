"""The assembler: when a scan is complete, and that batches do not matter."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from ars408_frames import CYCLE_NS, cycle, radar_scans, same_arrays, state_frame
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from radar_strategies import (
    assembled,
    comparable,
    disturbed,
    scans_of,
    streams,
)

from drivers.ars408 import RMS_METRES, ScanAssembler, sensor_can_ids
from drivers.can_frames import CanFrames, concatenate
from drivers.candump import read_candump
from drivers.encode import encode_motion, encode_state
from drivers.scan import MotionInput, RadarScan, RadarState


@given(streams(), st.lists(st.integers(1, 40), max_size=20))
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_batches_make_no_difference(frames: CanFrames, cuts: list[int]) -> None:
    at_once = [comparable(item) for item in assembled([frames])]
    one_by_one = [frames.select(slice(row, row + 1)) for row in range(len(frames))]
    assert [comparable(item) for item in assembled(one_by_one)] == at_once
    bounds = [0, *np.minimum(np.cumsum(np.array(cuts, int)), len(frames)).tolist(), len(frames)]
    pieces = [frames.select(slice(*piece)) for piece in pairwise(bounds)]
    assert [comparable(item) for item in assembled(pieces)] == at_once


def test_what_is_missing_counts_down_to_the_scan() -> None:
    assembler = ScanAssembler()
    assembler.feed(state_frame(quality=True))
    _, frames = cycle(0, 3)
    left = []
    for row in range(len(frames)):
        assembler.feed(frames.select(slice(row, row + 1)))
        left.append(assembler.missing)
    assert left == [6, 5, 4, 3, 2, 1, 0]


@given(st.lists(st.integers(3, 6), min_size=1, max_size=8), st.data())
@settings(max_examples=50, deadline=None)
def test_every_frame_is_accounted_for(sizes: list[int], data: st.DataObject) -> None:
    cycles = concatenate([cycle(number, n)[1] for number, n in enumerate(sizes)])
    frames = data.draw(disturbed(cycles, ["lose", "repeat", "move"]))
    assembler = ScanAssembler()
    assembler.feed(state_frame(quality=True))
    scans = radar_scans(assembler.feed(frames) + assembler.flush())
    in_scans = sum(1 + 2 * (scan.near + scan.far) - scan.frames_lost for scan in scans)
    beside = sum(scan.duplicates + scan.strays for scan in scans) + assembler.strays
    assert in_scans + beside == len(frames)


@given(st.integers(0, 2**32), st.integers(1, 400))
@settings(max_examples=50, deadline=None)
def test_noise_on_the_bus_never_fails(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    known = np.array([can_id for k in range(8) for can_id in sensor_can_ids(k)], np.uint32)
    foreign = rng.integers(0, 2**29, n)
    frames = CanFrames(
        stamp_ns=rng.integers(-(2**62), 2**62, n),
        can_id=np.where(
            rng.random(n) < 0.8, rng.choice(known[: rng.integers(1, 80)], n), foreign
        ).astype(np.uint32),
        length=rng.choice(np.array([0, 1, 2, 4, 5, 7, 8, 8, 8, 64], np.uint8), n),
        data=rng.integers(0, rng.choice([2, 5, 256]), (n, 64), dtype=np.uint8),
        flags=np.where(rng.random(n) < 0.9, 0, rng.integers(0, 128, n)).astype(np.uint8),
        channel=np.zeros(n, np.uint8),
    )
    half = n // 2
    halves = [frames.select(slice(half)), frames.select(slice(half, n))]
    assert [comparable(item) for item in assembled([frames])] == [
        comparable(item) for item in assembled(halves)
    ]


# A scan is complete with its last frame


@pytest.mark.parametrize(
    ("mode", "lists"),
    [
        ("cluster", [False]),
        ("cluster", [True]),
        ("object", [False, False]),
        ("object", [True, False]),
        ("object", [True, True]),
    ],
)
def test_a_scan_is_given_out_with_its_last_frame(mode: str, lists: list[bool]) -> None:
    scan, frames = cycle(0, 20, *lists, mode=mode)
    assembler = ScanAssembler()
    assembler.feed(state_frame(quality=lists[0], extended=lists[-1]))
    assert assembler.feed(frames.select(slice(len(frames) - 1))) == []
    (found,) = radar_scans(assembler.feed(frames.select(slice(len(frames) - 1, None))))
    assert same_arrays(found, scan)
    assert found.frames_lost == found.strays == found.duplicates == 0
    assert assembler.flush() == []


def test_the_first_scan_waits_until_a_radar_state_says_what_comes() -> None:
    _, frames = cycle(0, 5, False)
    assembler = ScanAssembler()
    assert assembler.feed(frames) == []
    assert assembler.feed(encode_motion(1.0, 0.0)) != []
    found = assembler.feed(state_frame(quality=False))
    assert [type(item) for item in found] == [RadarScan, RadarState]
    _, frames = cycle(1, 5, False)
    assert len(radar_scans(assembler.feed(frames))) == 1


def test_the_first_scan_waits_until_the_next_status_frame_or_the_end() -> None:
    frames = [cycle(number, 5, False)[1] for number in range(3)]
    assembler = ScanAssembler()
    assert assembler.feed(frames[0]) == []
    assert [scan.sequence for scan in radar_scans(assembler.feed(frames[1]))] == [0, 1]
    assert [scan.sequence for scan in radar_scans(assembler.feed(frames[2]))] == [2]
    alone = ScanAssembler()
    alone.feed(frames[0])
    assert [scan.frames_lost for scan in radar_scans(alone.flush())] == [0]


def test_quality_that_begins_unannounced_costs_one_scan_its_quality() -> None:
    assembler = ScanAssembler()
    assembler.feed(state_frame(quality=False))
    assembler.feed(cycle(0, 4, False)[1])
    (bare,) = radar_scans(assembler.feed(cycle(1, 4, True)[1]))
    assert bare.pdh0 is None
    scan, frames = cycle(2, 4, True)
    (found,) = radar_scans(assembler.feed(frames))
    assert same_arrays(found, scan)
    assert found.strays == 4  # the quality frames of the scan before


def test_quality_that_ends_unannounced_is_missed_three_times() -> None:
    assembler = ScanAssembler()
    found = assembler.feed(cycle(0, 4, True)[1])
    for number in range(1, 6):
        found += assembler.feed(cycle(number, 4, False)[1])
    assert [scan.frames_lost for scan in radar_scans(found)] == [0, 4, 4, 4, 0, 0]


def test_a_burst_that_swallows_a_quality_list_does_not_cost_the_next_one() -> None:
    assembler = ScanAssembler()
    cycles = [cycle(number, 4, True)[1] for number in range(4)]
    found = assembler.feed(cycles[0])
    found += assembler.feed(cycles[1].select(slice(5)))  # status and general list
    found += assembler.feed(cycles[2])
    found += assembler.feed(cycles[3])
    assert [scan.frames_lost for scan in radar_scans(found)] == [0, 4, 0, 0]
    assert [scan.strays for scan in radar_scans(found)] == [0, 0, 0, 0]


def test_lists_that_are_missed_now_and_then_stay_expected() -> None:
    parts = []
    for number in range(12):
        _, frames = cycle(number, 4 * (number % 3 != 1), True)
        parts.append(frames.select(slice(5)) if number % 3 == 0 else frames)
    scans = scans_of([state_frame(quality=True), concatenate(parts)])
    assert [scan.frames_lost for scan in scans] == [4, 0, 0] * 4
    assert all(scan.strays == 0 for scan in scans)


def test_an_empty_scan_is_given_out_at_once() -> None:
    _, frames = cycle(0, 0)
    (scan,) = radar_scans(ScanAssembler().feed(frames))
    assert len(scan) == 0
    assert scan.x.dtype == np.float32
    assert scan.id.dtype == np.uint8


# What is lost, repeated or foreign is counted


def test_radars_on_one_bus_are_told_apart_by_their_ids() -> None:
    cycles = {n: cycle(0, 5 + n, True, sensor_id=n) for n in range(8)}
    frames = concatenate([frames for _, frames in cycles.values()])
    order = np.argsort(frames.stamp_ns, kind="stable")
    scans = scans_of([frames.select(order)])
    assert sorted(scan.sensor for scan in scans) == [f"radar_{n}" for n in range(8)]
    for scan in scans:
        assert same_arrays(scan, cycles[scan.sensor_id][0])
        assert scan.strays == 0


def test_only_named_sensors_are_assembled() -> None:
    frames = concatenate([cycle(0, 3, False, sensor_id=n)[1] for n in range(3)])
    assembler = ScanAssembler({1: "rear"})
    found = assembler.feed(frames) + assembler.flush()
    assert [(scan.sensor, scan.sensor_id) for scan in radar_scans(found)] == [("rear", 1)]
    assert sensor_can_ids(1) == [
        0x211, 0x310, 0x311, 0x610, 0x61A, 0x61B, 0x61C, 0x61D, 0x711, 0x712,
    ]  # fmt: skip


def test_state_and_motion_are_given_out_in_order() -> None:
    frames = concatenate(
        [
            encode_motion(-3.0, 1.25, stamp_ns=1),
            encode_state(
                RadarState("", 0, 2_000_000, {"RadarState_MaxDistanceCfg": 250.0}),
            ),
            encode_motion(0.001, -1.25, stamp_ns=3_000_000, sensor_id=2),
        ]
    )
    reverse, turning, state, still, turning_2 = ScanAssembler().feed(frames)
    assert reverse == MotionInput(0, 1, -3.0, None)
    assert isinstance(turning, MotionInput)
    assert (turning.speed, turning.yaw_rate) == (-3.0, 1.25)
    assert isinstance(state, RadarState)
    assert (state.sensor, state.stamp_ns) == ("radar_0", 2_000_000)
    assert state.values["RadarState_MaxDistanceCfg"] == 250.0
    assert len(state.values) == 17
    assert isinstance(still, MotionInput)
    assert (still.sensor_id, still.speed, still.yaw_rate) == (2, 0.0, None)
    assert isinstance(turning_2, MotionInput)
    assert turning_2.yaw_rate == pytest.approx(-1.25)


def test_a_scan_carries_stamp_source_and_drops_of_its_frames() -> None:
    _, frames = cycle(3, 2, False)
    (scan,) = scans_of([replace(frames, stamp_source="kernel", dropped=7)])
    assert (scan.stamp_ns, scan.stamp_source, scan.dropped) == (3 * CYCLE_NS, "kernel", 7)


def test_rms_table() -> None:
    assert RMS_METRES.shape == (32,)
    assert RMS_METRES[[0, 10, 30]].tolist() == [0.005, 0.063, 10.0]
    assert np.isnan(RMS_METRES[31])


# Real recordings


SCENES = ["0061", "0553", "0655", "0757", "0796", "1077", "1100"]


def test_real_clusters_equal_the_arrays(data: Path) -> None:
    not_on_the_wire = {"z", "vx_comp", "vy_comp", "is_quality_valid"}
    scans_found = clusters_found = 0
    for scene in SCENES:
        path = data / "radar" / "nuscenes_mini" / f"scene-{scene}.log"
        truth = np.load(path.with_suffix(".npz"))
        columns = dict(zip(truth["fields"].tolist(), truth["points"].T, strict=True))
        scans = scans_of(list(read_candump(path)))
        for scan, (begin, end) in zip(scans, pairwise(truth["offsets"]), strict=True):
            assert scan.frames_lost == scan.duplicates == scan.strays == 0
            for name, values in scan.arrays().items():
                np.testing.assert_array_equal(values, columns[name][begin:end])
            assert set(scan.arrays()) == set(columns) - not_on_the_wire
        np.testing.assert_allclose([scan.stamp_ns for scan in scans], truth["stamp_us"] * 1000)
        scans_found += len(scans)
        clusters_found += sum(map(len, scans))
    assert (scans_found, clusters_found) == (283, 34673)


@pytest.mark.parametrize(
    ("name", "scans", "objects", "states", "motions"),
    [
        ("object_mode_144s.log", 2001, 5609, 144, 5762),
        ("object_mode_38s.log", 515, 2996, 38, 0),
    ],
)
def test_real_object_recordings(
    data: Path, name: str, scans: int, objects: int, states: int, motions: int
) -> None:
    items = assembled(list(read_candump(data / "radar" / "candump" / name)))
    found = radar_scans(items)
    assert (len(found), sum(map(len, found))) == (scans, objects)
    assert sum(isinstance(item, RadarState) for item in items) == states
    assert sum(isinstance(item, MotionInput) for item in items) == motions
    for scan in found:
        assert scan.frames_lost == scan.cycles_lost == scan.duplicates == scan.strays == 0
        assert scan.mode == "object"
        assert scan.length is not None
        assert scan.meas_state is not None
    assert [scan.sequence for scan in found] == list(range(scans))
