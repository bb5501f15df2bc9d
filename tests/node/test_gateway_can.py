from __future__ import annotations

from functools import cache
from typing import Any

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dbc
from drivers.ars408 import ScanAssembler
from drivers.can_frames import CanFrames, FrameFlag, concatenate
from drivers.scan import RadarScan
from models.degrade.kinds import KINDS
from node.link_faults import LINK_FAULTS
from node.scene import Injection, Sensor
from tests.node.gateway_stream import (
    CYCLE_NS,
    EPOCH_NS,
    SPACING_NS,
    Clock,
    gateway,
    merged,
    other_frames,
    radar_frames,
    scheduled,
    wire,
)

OTHER_IDS = (0x008, 0x201, 0x300, 0x610, 0x60A, 0x700, 0x711, 0x7FF)
LAST_FRAME = 80 * SPACING_NS
"""From the first to the last frame of a scan of 40 clusters with quality."""


def scans(frames: CanFrames) -> list[RadarScan]:
    assembler = ScanAssembler({0: "radar"})
    items = [*assembler.feed(frames), *assembler.flush()]
    return [item for item in items if isinstance(item, RadarScan)]


def stream(cycles: int, **options: Any) -> CanFrames:
    return concatenate([radar_frames(number, **options) for number in range(cycles)])


def is_list(frames: CanFrames) -> Any:
    return np.isin(frames.can_id, (0x600, 0x701, 0x702))


def test_level_0_is_a_wire_to_the_bit_over_100000_frames() -> None:
    some = merged(stream(200), other_frames(EPOCH_NS + np.arange(800) * 17_000_000, [0x201] * 800))
    core, _ = gateway({"snr": 0, "drop": 0})
    count = 0
    for batch in range(6):
        clock = Clock(core)
        clock.now_ns = batch * 200 * CYCLE_NS
        clock.play(some, batch=37)
        assert wire(clock.frames) == wire(some)
        assert (clock.times_ns == np.maximum.accumulate(clock.times_ns)).all()
        count += len(some)
    assert count > 100_000
    assert core.next_due_ns() is None


def test_level_0_sends_every_frame_at_once() -> None:
    frames = stream(3)
    clock = Clock(gateway()[0]).play(frames)
    np.testing.assert_array_equal(clock.times_ns, frames.stamp_ns - EPOCH_NS)


@settings(max_examples=40, deadline=None)
@given(
    kind=st.sampled_from([*KINDS["radar"], *sorted({*LINK_FAULTS} - {"silence", "babble"})]),
    level=st.sampled_from([0.0, 1.0, 60.0, 100.0]),
    others=st.lists(
        st.tuples(st.integers(0, 4 * CYCLE_NS), st.sampled_from(OTHER_IDS)), min_size=1
    ),
    lost=st.sets(st.integers(0, 300)),
    batch=st.integers(1, 90),
    quality=st.booleans(),
)
def test_other_frames_pass_untouched_in_order_and_at_once(
    kind: str,
    level: float,
    others: list[tuple[int, int]],
    lost: set[int],
    batch: int,
    quality: bool,
) -> None:
    others.sort()
    foreign = other_frames([EPOCH_NS + t for t, _ in others], [i for _, i in others])
    radar = stream(4, quality=quality)
    radar = radar.select(~np.isin(np.arange(len(radar)), list(lost)))
    frames = merged(radar, foreign)
    clock = Clock(gateway({kind: level})[0]).play(frames, batch).rest()
    passed = ~is_list(clock.frames)
    assert wire(clock.frames.select(passed)) == wire(foreign)
    came_ns = np.array(clock.fed_ns)
    np.testing.assert_array_equal(clock.times_ns[passed], came_ns[~is_list(frames)])


@cache
def database() -> Any:
    return cantools.database.load_file(f"{dbc.__path__[0]}/ars408.dbc")


@pytest.mark.parametrize("kind", KINDS["radar"])
@pytest.mark.parametrize("quality", [True, False])
def test_what_leaves_is_what_a_radar_could_have_sent(kind: str, quality: bool) -> None:
    came = stream(20, quality=quality)
    clock = Clock(gateway({kind: 60})[0]).play(came).rest()
    out = clock.frames
    assert wire(out) != wire(came)
    assert is_list(out).all()
    before, after = scans(came), scans(out)
    assert len(after) == len(before) == 20
    for old, new in zip(before, after, strict=True):
        assert new.frames_lost == new.cycles_lost == new.strays == new.duplicates == 0
        assert len(new) == new.near + new.far
        assert new.meas_counter == old.meas_counter
        assert (new.pdh0 is None) == (not quality)
        np.testing.assert_array_equal(new.id, np.arange(len(new)))
    for can_id, length, data, _ in wire(out):
        message = database().get_message_by_frame_id(can_id)
        assert length == message.length
        values = message.decode(data, decode_choices=False)
        for signal in message.signals:
            low, high = signal.minimum, signal.maximum
            assert low - 1e-9 <= values[signal.name] <= high + 1e-9, signal.name
        assert data[4] & 0xF0 == 0x10 or can_id != 0x600, "the interface version is kept"


def test_a_scan_leaves_as_much_later_as_it_took_to_come_and_at_its_spacing() -> None:
    came = stream(20)
    clock = Clock(gateway({"missed": 60})[0]).play(came).rest()
    starts = np.flatnonzero(clock.frames.can_id == 0x600)
    came_ns = np.arange(20) * CYCLE_NS
    np.testing.assert_array_equal(clock.times_ns[starts], came_ns + LAST_FRAME)
    assert LAST_FRAME < CYCLE_NS
    for scan_ns in np.split(clock.times_ns, starts[1:]):
        assert (np.diff(scan_ns) == SPACING_NS).all()


def test_a_gateway_that_was_not_running_for_a_while_makes_good_for_it_within_the_scan() -> None:
    stalled_ns, came = 6_000_000, stream(2)
    clock = Clock(gateway({"missed": 1})[0]).play(came.select(slice(0, 140)))
    clock.advance(CYCLE_NS + LAST_FRAME + stalled_ns)
    clock.play(came.select(slice(140, None)), batch=81).rest()
    start = np.flatnonzero(clock.frames.can_id == 0x600)[1]
    late_ns = clock.times_ns[start:] - (CYCLE_NS + LAST_FRAME)
    assert late_ns[0] == stalled_ns
    assert late_ns[-1] == (len(late_ns) - 1) * SPACING_NS
    assert (np.diff(late_ns) > 0).all(), "no burst"


def test_ghosts_do_not_make_a_scan_longer() -> None:
    clock = Clock(gateway({"ghosts": 100})[0]).play(stream(20)).rest()
    starts = np.flatnonzero(clock.frames.can_id == 0x600)
    lengths = np.diff(starts)
    assert lengths.max() > 81
    for scan_ns in np.split(clock.times_ns, starts[1:]):
        assert scan_ns[-1] - scan_ns[0] == LAST_FRAME


@pytest.mark.parametrize("lost", [1, 20, 60])
def test_an_incomplete_scan_is_sent_as_it_came(lost: int) -> None:
    whole, after = radar_frames(0), radar_frames(2)
    half = radar_frames(1).select(np.arange(81) != lost)
    core, _ = gateway({"snr": 60})
    clock = Clock(core).play(concatenate([whole, half, after])).rest()
    assert core.counts["incomplete"] == 1
    assert core.counts["degraded"] == 2
    starts = np.flatnonzero(clock.frames.can_id == 0x600)
    middle = slice(starts[1], starts[2])
    assert wire(clock.frames.select(middle)) == wire(half)
    assert clock.times_ns[starts[1]] == 2 * CYCLE_NS, "the next status frame shows that it is half"


def test_a_half_scan_after_which_nothing_comes_is_sent_after_two_cycles() -> None:
    half = radar_frames(0).select(slice(0, 30))
    clock = Clock(gateway({"snr": 60})[0]).play(half)
    assert not clock.sent
    clock.rest()
    assert wire(clock.frames) == wire(half)
    assert CYCLE_NS < clock.times_ns[0] <= 2.2 * CYCLE_NS


def test_a_radar_without_quality_is_known_after_a_short_wait_and_then_at_once() -> None:
    clock = Clock(gateway({"snr": 60})[0]).play(stream(4, quality=False)).rest()
    starts = clock.times_ns[clock.frames.can_id == 0x600]
    late_ns = starts - np.arange(4) * CYCLE_NS
    assert (late_ns[1:] == 40 * SPACING_NS).all()
    assert late_ns[1] < late_ns[0] < CYCLE_NS


def test_an_empty_scan_passes() -> None:
    empty = radar_frames(0, clusters=0)
    clock = Clock(gateway({"snr": 60})[0]).play(empty).rest()
    assert wire(clock.frames) == wire(empty)
    assert clock.now_ns <= SPACING_NS


@settings(max_examples=25, deadline=None)
@given(
    changes=st.lists(st.tuples(st.integers(0, 8 * 81), st.sampled_from([0, 30, 100])), max_size=8),
    batch=st.integers(1, 100),
    clusters=st.sampled_from([5, 40]),
)
def test_a_switch_neither_mixes_nor_reorders_scans(
    changes: list[tuple[int, float]], batch: int, clusters: int
) -> None:
    came = stream(8, clusters=clusters)
    core, levels = gateway({"missed": 60})
    clock = Clock(core)
    marks = sorted(changes)
    at = 0
    for mark, level in [*marks, (len(came), 0)]:
        end = max(at, min(mark, len(came)))
        clock.play(came.select(slice(at, end)), batch)
        levels.set_level("missed", level)
        at = end
    clock.rest()
    after = scans(clock.frames)
    assert [scan.meas_counter for scan in after] == [2 * k for k in range(8)]
    assert all(scan.frames_lost == scan.strays == scan.duplicates == 0 for scan in after)
    assert (np.diff(clock.times_ns) >= 0).all()
    order = clock.frames.select(is_list(clock.frames)).stamp_ns
    assert (np.diff(order) >= 0).all()


def test_a_switch_back_to_a_wire_catches_up_at_the_bus_speed() -> None:
    core, levels = gateway({"snr": 60})
    clock = Clock(core).play(stream(2))
    levels.set_level("snr", 0)
    late = concatenate([radar_frames(number) for number in range(2, 6)])
    clock.play(late).rest()
    latency_ns = clock.times_ns - (clock.frames.stamp_ns - EPOCH_NS)
    assert latency_ns[0] == LAST_FRAME
    assert latency_ns[-1] == 0


def test_the_schedule_of_the_scene_is_followed() -> None:
    injection = Injection(sensor="radar", kind="missed", points=((0.5, 100.0), (1.0, 0.0)))
    core = scheduled(injection)
    clock = Clock(core).play(stream(20)).rest()
    t_s = np.arange(20) * CYCLE_NS * 1e-9
    fewer = np.array([len(scan) < 40 for scan in scans(clock.frames)])
    np.testing.assert_array_equal(fewer, (t_s >= 0.5) & (t_s < 1.0))


def test_the_seed_repeats_a_run_and_the_batches_do_not_matter() -> None:
    came = stream(5)
    first, again, other = (
        Clock(gateway({"snr": 60}, seed=seed)[0]).play(came, batch).rest()
        for seed, batch in ((1, 1), (1, 50), (2, 1))
    )
    assert wire(first.frames) == wire(again.frames) != wire(other.frames)


def test_the_radar_is_chosen_by_its_sensor_id() -> None:
    second = Sensor(name="rear", type="radar", source="virtual:in", sensor_id=1)
    ours = stream(3, sensor_id=1)
    other = stream(3)
    clock = Clock(gateway({"snr": 60}, second)[0]).play(merged(ours, other)).rest()
    out = clock.frames
    assert wire(out.select(is_list(out))) == wire(other)
    assert wire(out.select(~is_list(out))) != wire(ours)
    assert {0x610, 0x711, 0x712} == set(out.can_id[~is_list(out)].tolist())


@pytest.mark.parametrize("flag", [FrameFlag.EXTENDED, FrameFlag.REMOTE, FrameFlag.FD])
def test_frames_that_only_look_like_clusters_pass(flag: FrameFlag) -> None:
    frames = radar_frames(0)
    frames.flags[:] = flag
    clock = Clock(gateway({"snr": 100})[0]).play(frames)
    assert wire(clock.frames) == wire(frames)


def test_frames_too_short_for_clusters_pass() -> None:
    frames = radar_frames(0)
    frames.length[:] = 2
    clock = Clock(gateway({"snr": 100})[0]).play(frames)
    assert wire(clock.frames) == wire(frames)


@pytest.mark.parametrize("level", [0, 60])
@pytest.mark.parametrize("cut", [1, 100, 161, 162, 200])
def test_the_end_leaves_no_half_scan_on_the_wire(level: float, cut: int) -> None:
    came = stream(4)
    core, _ = gateway({"snr": level})
    clock = Clock(core).play(came.select(slice(0, cut)))
    core.finish()
    clock.play(came.select(slice(cut, None))).finish()
    after = scans(clock.frames) if clock.sent else []
    assert all(scan.frames_lost == 0 for scan in after)
    begun = int(np.count_nonzero(came.can_id[:cut] == 0x600))
    finished = cut // 81
    assert len(after) == (begun if level == 0 else finished)
    assert core.finished


def test_the_end_does_not_wait_for_a_radar_that_has_died() -> None:
    core, _ = gateway()
    clock = Clock(core).play(radar_frames(0).select(slice(0, 30)))
    clock.finish()
    assert clock.now_ns <= 3 * CYCLE_NS


@pytest.mark.parametrize("fault", LINK_FAULTS)
def test_faults_reach_the_wire_and_end_when_they_are_taken_back(fault: str) -> None:
    core, levels = gateway({fault: 100})
    clock = Clock(core).play(stream(6)).rest()
    assert core.faults.counts[fault] > 0
    levels.set_level(fault, 0)
    cut = len(clock.sent)
    more = concatenate([radar_frames(number) for number in range(7, 9)])
    clock.play(more).rest()
    assert wire(concatenate([frames for _, frames in clock.sent[cut:]])) == wire(more)


def test_silence_silences_every_frame_and_the_end_of_it_none() -> None:
    foreign = other_frames(EPOCH_NS + np.arange(100) * 9_000_000, [0x201] * 100)
    core, levels = gateway({"silence": 100})
    clock = Clock(core).play(merged(stream(6), foreign.select(slice(0, 48))))
    before = len(clock.sent)
    levels.set_level("silence", 0)
    assert {time < LAST_FRAME + 2e6 for time, _ in clock.sent} == {True}
    clock.play(merged(radar_frames(6), foreign.select(slice(48, 50)))).rest()
    assert len(clock.sent) - before >= 81
    assert core.counts["silenced"] > 6 * 81


def test_a_dead_wire_lives_again_when_the_radar_has_died() -> None:
    core, _ = gateway({"silence": 100})
    clock = Clock(core).play(stream(2))
    late = other_frames([EPOCH_NS + 10 * CYCLE_NS], [0x201])
    clock.play(late)
    assert wire(clock.frames) == wire(late)
