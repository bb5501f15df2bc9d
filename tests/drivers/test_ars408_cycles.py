from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drivers.ars408_cycles import find_cycles, replace_cycles
from drivers.ars408_layout import CAN_ID, ID_SHIFT, Kind
from drivers.can_frames import NO_FRAMES, CanFrames, concatenate
from drivers.can_log import read_log
from drivers.encode import encode_motion, encode_scan
from drivers.scan import RadarScan
from tests.drivers.radar_strategies import random_scan, streams

LISTS = (Kind.CLUSTER_STATUS, Kind.CLUSTER_GENERAL, Kind.CLUSTER_QUALITY)
CLUSTER_IDS = [CAN_ID[kind] + ID_SHIFT * sensor_id for kind in LISTS for sensor_id in range(8)]


def first_clusters(scan: RadarScan, count: int) -> RadarScan:
    """Return the scan with its first clusters repeated or left out until there are ``count``."""
    rows = np.arange(count) % len(scan)
    arrays: dict[str, Any] = {name: array[rows] for name, array in scan.arrays().items()}
    arrays["id"] = np.arange(count, dtype=np.uint8)
    return replace(scan, near=count, far=0, **arrays)


def lines(frames: CanFrames) -> list[tuple[Any, ...]]:
    columns = (frames.stamp_ns, frames.can_id, frames.length, frames.flags)
    return [(*map(int, row), data.tobytes()) for *row, data in zip(*columns, frames.data)]  # noqa: B905


def cycle_of(n: int, start_ns: int, counter: int = 0) -> CanFrames:
    rng = np.random.default_rng(n)
    scan = random_scan(rng, n, "cluster", [True], stamp_ns=start_ns, meas_counter=counter)
    return replace(encode_scan(scan, 1_000_000), stamp_source="file")


@given(frames=streams())
def test_cycles_that_change_into_themselves_leave_every_other_frame(frames: CanFrames) -> None:
    cycles = list(find_cycles(frames))
    after = replace_cycles(frames, [(cycle, cycle.scan) for cycle in cycles])
    taken = {int(row) for cycle in cycles for row in cycle.rows}
    passing = [line for row, line in enumerate(lines(frames)) if row not in taken]
    is_cluster = np.isin(after.can_id, CLUSTER_IDS)
    others = [line for line in passing if line[1] not in CLUSTER_IDS]
    assert [line for line, own in zip(lines(after), is_cluster, strict=True) if not own] == others
    assert set(passing) <= set(lines(after))


@given(
    counts=st.lists(st.tuples(st.integers(1, 30), st.integers(0, 40)), min_size=1, max_size=4),
    gap_ms=st.integers(1, 200),
)
def test_the_new_scan_is_read_back_and_nothing_moves(
    counts: list[tuple[int, int]], gap_ms: int
) -> None:
    parts, start_ns = [], 5_000_000
    for number, (before, _) in enumerate(counts):
        parts += [cycle_of(before, start_ns, 2 * number), encode_motion(3.0, 1.0, start_ns + 7)]
        start_ns = int(parts[-2].stamp_ns[-1]) + gap_ms * 1_000_000
    frames = concatenate(parts)
    frames = frames.select(np.argsort(frames.stamp_ns, kind="stable"))
    cycles = list(find_cycles(frames))
    assert [len(cycle.scan) for cycle in cycles] == [before for before, _ in counts]
    wanted = [
        first_clusters(cycle.scan, after) for cycle, (_, after) in zip(cycles, counts, strict=True)
    ]
    changed = replace_cycles(frames, list(zip(cycles, wanted, strict=True)))
    assert (np.diff(changed.stamp_ns) >= 0).all()
    found = {cycle.scan.meas_counter: cycle.scan for cycle in find_cycles(changed)}
    for scan in wanted:
        if not len(scan):
            continue
        again = found[scan.meas_counter]
        assert (again.stamp_ns, again.near, again.far) == (scan.stamp_ns, scan.near, scan.far)
        assert (again.frames_lost, again.strays, again.duplicates) == (0, 0, 0)
        for name, array in scan.arrays().items():
            np.testing.assert_array_equal(array, again.arrays()[name])


def test_a_longer_scan_goes_on_as_far_apart_and_ends_before_the_next() -> None:
    frames = concatenate([cycle_of(3, 0), cycle_of(3, 20_000_000, 2)])
    first, second = find_cycles(frames)
    longer = first_clusters(first.scan, 5)
    stamps = replace_cycles(frames, [(first, longer)]).stamp_ns[:11]
    assert stamps.tolist() == [n * 1_000_000 for n in range(11)]
    tight = replace(first, end_ns=int(frames.stamp_ns[6]) + 50_000)
    stamps = replace_cycles(frames, [(tight, longer)]).stamp_ns[7:11]
    assert stamps.tolist() == [6_010_000, 6_020_000, 6_030_000, 6_040_000]
    assert (first.end_ns, second.end_ns) == (20_000_000, None)


def test_the_status_frame_changes_nothing_but_its_counts() -> None:
    frames = cycle_of(3, 0, 513)
    frames.data[0, 4] = 0x35  # interface version and reserved bits that encode_scan never says
    (cycle,) = find_cycles(frames)
    changed = replace_cycles(frames, [(cycle, first_clusters(cycle.scan, 2))])
    assert changed.data[0].tolist() == [2, 0, 2, 1, 0x35, 0, 0, 0]


def test_two_interfaces_are_two_radars() -> None:
    one, other = cycle_of(3, 0), cycle_of(4, 500)
    frames = concatenate([replace(one, channels=("can0",)), replace(other, channels=("can1",))])
    frames = frames.select(np.argsort(frames.stamp_ns, kind="stable"))
    cycles = list(find_cycles(frames))
    assert [(cycle.sensor, len(cycle.scan)) for cycle in cycles] == [
        ("can0.radar_0", 3),
        ("can1.radar_0", 4),
    ]
    changed = replace_cycles(frames, [(cycles[1], first_clusters(cycles[1].scan, 2))])
    assert (
        changed.select(changed.channel == 1).can_id.tolist() == [0x600, 0x701, 0x701] + [0x702] * 2
    )
    assert lines(changed.select(changed.channel == 0)) == lines(one)


def test_no_frames_no_cycles() -> None:
    assert list(find_cycles(NO_FRAMES)) == []
    assert len(replace_cycles(NO_FRAMES, [])) == 0


def test_real_cycles_are_those_of_the_assembler(data: Path) -> None:
    path = data / "radar" / "nuscenes_mini" / "scene-0553.log"
    frames = concatenate(list(read_log(path)))
    cycles = list(find_cycles(frames))
    assert [cycle.scan.sequence for cycle in cycles] == list(range(41))
    assert sum(len(cycle.rows) for cycle in cycles) == len(frames)
    assert lines(replace_cycles(frames, [(c, c.scan) for c in cycles])) == lines(frames)


def test_object_lists_are_no_cluster_cycles(data: Path) -> None:
    frames = next(read_log(data / "radar" / "candump" / "object_mode_38s.log"))
    assert list(find_cycles(frames)) == []
