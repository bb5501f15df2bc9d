"""The assembler: frames and cycles that were lost, came twice or belong to no scan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ars408_frames import cycle, radar_scans, same_arrays, state_frame, without
from radar_strategies import (
    scans_of,
    shuffled_last,
)

from drivers.ars408 import ScanAssembler
from drivers.can_frames import FrameFlag, concatenate


@pytest.mark.parametrize("row", [1, 4, 5, 8])
def test_a_lost_list_frame_is_marked_when_the_next_cycle_comes(row: int) -> None:
    scan, frames = cycle(0, 4, True)
    assembler = ScanAssembler()
    assembler.feed(state_frame(quality=True))
    assert assembler.feed(without(frames, row)) == []
    first, second = radar_scans(assembler.feed(cycle(1, 4, True)[1]))
    assert (first.frames_lost, first.strays, second.frames_lost) == (1, 0, 0)
    assert first.near + first.far == 4
    if row <= 4:  # a cluster is missing, with the quality that came
        np.testing.assert_array_equal(first.id, np.delete(scan.id, row - 1))
        np.testing.assert_array_equal(first.pdh0, np.delete(scan.pdh0, row - 1))
    else:  # only its quality is
        np.testing.assert_array_equal(first.x, scan.x)
        expected = {"pdh0": 0, "ambig_state": 0, "invalid_state": 31, "x_rms": 31}
        for name, value in expected.items():
            assert getattr(first, name)[row - 5] == value
            np.testing.assert_array_equal(
                np.delete(getattr(first, name), row - 5), np.delete(getattr(scan, name), row - 5)
            )


def test_a_lost_extended_frame_leaves_nan() -> None:
    scan, frames = cycle(0, 3, True, True, mode="object")
    (found,) = scans_of([without(frames, 8)])
    assert found.frames_lost == 1
    assert found.length is not None
    assert np.isnan(found.length).tolist() == [False, True, False]
    assert found.object_class is not None
    assert found.object_class[1] == 7
    np.testing.assert_array_equal(found.prob_of_exist, scan.prob_of_exist)


def test_quality_is_joined_by_cluster_id() -> None:
    scan, frames = cycle(0, 50, True)
    rng = np.random.default_rng(0)
    cycles = [shuffled_last(cycle(n, 50, True)[1], 50, rng) for n in range(1, 4)]
    scans = scans_of([concatenate([frames, *cycles])])
    assert same_arrays(scans[0], scan)
    for number, found in enumerate(scans[1:], start=1):
        assert same_arrays(found, cycle(number, 50, True)[0])


def test_a_frame_that_comes_twice_is_a_duplicate_and_the_first_one_counts() -> None:
    scan, frames = cycle(0, 4, True)
    twice = frames.select(np.r_[0, 0, 1, 2, 2, 3, 4, 5, 5, 6, 7, 8])
    twice.data[4, 1] ^= 0xFF
    assembler = ScanAssembler()
    assembler.feed(state_frame(quality=True))
    (found,) = radar_scans(assembler.feed(twice))
    assert (found.duplicates, found.strays, found.frames_lost) == (3, 0, 0)
    assert same_arrays(found, scan)


def test_frames_of_no_scan_are_strays_of_the_next() -> None:
    _, first = cycle(0, 4, True)
    _, second = cycle(1, 4, True)
    late = first.select(np.array([2, 6]))  # come again after their scan was complete
    objects = cycle(0, 2, True, True, mode="object")[1]
    assembler = ScanAssembler()
    assembler.feed(state_frame(quality=True))
    assembler.feed(first)
    found = assembler.feed(concatenate([late, objects.select(slice(1, 3)), second, late]))
    assert [scan.strays for scan in radar_scans(found)] == [4]
    assert assembler.strays == 2


def test_more_frames_than_announced_are_strays() -> None:
    scan, frames = cycle(0, 6, False, near=1, far=3)
    assembler = ScanAssembler()
    assembler.feed(state_frame(quality=False))
    (found,) = radar_scans(assembler.feed(frames))
    assert len(found) == 4
    np.testing.assert_array_equal(found.id, scan.id[:4])
    assert assembler.strays == 2


def test_a_general_list_that_goes_on_is_cut_while_quality_is_awaited() -> None:
    scan, frames = cycle(0, 6, True, near=1, far=3)
    assembler = ScanAssembler()
    assembler.feed(state_frame(quality=True))
    quality = frames.select(np.array([7, 8, 9, 10]))
    (found,) = radar_scans(assembler.feed(concatenate([frames.select(slice(7)), quality])))
    assert found.strays == 2
    np.testing.assert_array_equal(found.id, scan.id[:4])
    np.testing.assert_array_equal(found.pdh0, scan.pdh0[:4])


def test_short_frames_of_a_scan_are_strays_not_zeros() -> None:
    _, frames = cycle(0, 4, False)
    assembler = ScanAssembler()
    assembler.feed(state_frame(quality=False))
    short_head = replace(frames.select(slice(1)), length=np.array([4], np.uint8))
    assert assembler.feed(short_head) == []
    frames.length[2] = 7
    (found,) = radar_scans(assembler.feed(frames) + assembler.flush())
    assert (len(found), found.frames_lost, found.strays) == (3, 1, 2)


def test_quality_of_unknown_clusters_is_stray() -> None:
    _, frames = cycle(0, 4, True)
    unused = next(value for value in range(256) if value not in frames.data[1:5, 0])
    frames.data[6, 0] = unused
    assembler = ScanAssembler()
    assembler.feed(state_frame(quality=True))
    (found,) = radar_scans(assembler.feed(frames))
    assert (found.strays, found.frames_lost) == (1, 1)
    assert found.pdh0 is not None
    assert found.pdh0[1] == 0


def test_a_count_that_lies_neither_fails_nor_piles_up() -> None:
    _, frames = cycle(0, 250, False, near=255, far=255)
    assembler = ScanAssembler()
    for _ in range(50):
        for scan in radar_scans(assembler.feed(frames)):
            assert len(scan) == 250
            assert scan.frames_lost >= 260
    stuck = frames.select(np.arange(1, 251))
    for _ in range(50):
        assert assembler.feed(stuck) == []
    (last,) = radar_scans(assembler.flush())
    assert last.duplicates == 50 * 250


def test_short_and_foreign_frames() -> None:
    scan, frames = cycle(0, 4, False)
    noise = [replace(frames, flags=np.full(5, flag, np.uint8)) for flag in (1, 2, 4, 8)]
    other = replace(frames, can_id=frames.can_id + 0x800)
    short = replace(frames.select(slice(1, 3)), length=np.array([7, 0], np.uint8))
    wide = replace(frames, data=np.pad(frames.data, ((0, 0), (0, 56))))
    assembler = ScanAssembler()
    assembler.feed(state_frame(quality=False))
    assert assembler.feed(concatenate([*noise, other, short])) == []
    (found,) = radar_scans(assembler.feed(wide))
    assert found.strays == 2
    assert same_arrays(found, scan)


def test_a_transmitted_frame_counts_like_a_received_one() -> None:
    scan, frames = cycle(0, 4, False)
    sent = replace(frames, flags=np.full(5, FrameFlag.TRANSMITTED, np.uint8))
    assert same_arrays(scans_of([sent])[0], scan)


# MeasCounter


def counted(*counters: int) -> list[tuple[int, int]]:
    frames = [cycle(0, 1, False, meas_counter=counter % 65536)[1] for counter in counters]
    return [(scan.sequence, scan.cycles_lost) for scan in scans_of([concatenate(frames)])]


@pytest.mark.parametrize("step", [1, 2, 3, 14])
def test_the_step_of_the_counter_is_learned(step: int) -> None:
    steps = [0, 1, 2, 3, 6, 7, 10]
    found = counted(*(65500 + step * number for number in steps))  # wraps on the way
    assert found == [(0, 0), (1, 0), (2, 0), (3, 0), (6, 2), (7, 0), (10, 2)]


def test_two_equal_gaps_in_a_row_do_not_unlearn_the_step() -> None:
    assert [lost for _, lost in counted(0, 2, 4, 8, 12, 14)] == [0, 0, 0, 1, 1, 0]


def test_a_gap_at_the_start_does_not_spoil_the_step() -> None:
    assert [lost for _, lost in counted(0, 10, 12, 14, 18)] == [0, 0, 0, 0, 1]


def test_a_restarted_radar_and_a_stuck_counter_lose_no_cycle() -> None:
    assert [lost for _, lost in counted(40000, 40002, 40004, 0, 2, 2, 2, 4)] == [0] * 8
    assert [lost for _, lost in counted(100, 102, 104, 0, 2)] == [0] * 5


def test_a_long_gap_is_believed_where_the_stamps_allow_it() -> None:
    steps = [0, 1, 2, 5002]
    frames = [cycle(step, 1, False)[1] for step in steps]
    assert [scan.cycles_lost for scan in scans_of(frames)] == [0, 0, 0, 4999]


# Several radars, names, state and motion
