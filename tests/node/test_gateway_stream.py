"""The gateway's mode of low latency: cluster by cluster."""

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
from drivers.can_frames import CanFrames, concatenate
from drivers.scan import RadarScan
from models.degrade import radar
from models.degrade.draw import DrawKey
from models.sensor import ARS408
from node.gateway_can import CanGateway
from node.gateway_levels import GatewayLevels
from tests.node.gateway_stream import (
    EPOCH_NS,
    RADAR,
    Clock,
    merged,
    other_frames,
    radar_frames,
    wire,
)


def gateway(levels: dict[str, float], seed: int = 1) -> CanGateway:
    control = GatewayLevels(RADAR, (), (), seed)
    for kind, level in levels.items():
        control.set_level(kind, level)
    return CanGateway(RADAR, control, seed, low_latency=True)


def scans(frames: CanFrames) -> list[RadarScan]:
    assembler = ScanAssembler({0: "radar"})
    items = [*assembler.feed(frames), *assembler.flush()]
    return [item for item in items if isinstance(item, RadarScan)]


def stream(cycles: int, clusters: int = 60, **options: Any) -> CanFrames:
    return concatenate([radar_frames(number, clusters, **options) for number in range(cycles)])


@cache
def database() -> Any:
    return cantools.database.load_file(f"{dbc.__path__[0]}/ars408.dbc")


@settings(max_examples=40, deadline=None)
@given(
    levels=st.dictionaries(st.sampled_from(radar.KINDS), st.sampled_from([1.0, 60.0, 100.0])),
    sizes=st.lists(st.integers(0, 125), min_size=2, max_size=5),
    quality=st.booleans(),
    batch=st.integers(1, 60),
    seed=st.integers(0, 100),
)
def test_what_is_announced_comes_and_a_radar_could_have_sent_it(
    levels: dict[str, float], sizes: list[int], quality: bool, batch: int, seed: int
) -> None:
    parts = [radar_frames(k, size, quality=quality) for k, size in enumerate(sizes)]
    came = concatenate(parts)
    clock = Clock(gateway(levels, seed)).play(came, batch).rest()
    after = scans(clock.frames)
    assert [scan.meas_counter for scan in after] == [2 * k for k in range(len(sizes))]
    for scan, size in zip(after, sizes, strict=True):
        assert scan.frames_lost == scan.duplicates == 0
        np.testing.assert_array_equal(scan.id, np.arange(len(scan)))
        assert size or not len(scan)
    for can_id, length, data, _ in wire(clock.frames):
        message = database().get_message_by_frame_id(can_id)
        assert length == message.length
        values = message.decode(data, decode_choices=False)
        for signal in message.signals:
            low, high = signal.minimum, signal.maximum
            assert low - 1e-9 <= values[signal.name] <= high + 1e-9, signal.name


def test_each_cluster_leaves_when_it_comes_from_the_second_scan_on() -> None:
    came = stream(6)
    clock = Clock(gateway({"missed": 60})).play(came).rest()
    latency_ns = clock.times_ns - (clock.frames.stamp_ns - EPOCH_NS)
    starts = np.flatnonzero(clock.frames.can_id == 0x600)
    assert latency_ns[0] > 0, "nothing is known before the first scan"
    assert (latency_ns[starts[1] :] == 0).all()


def test_level_0_is_a_wire() -> None:
    came = merged(stream(4), other_frames(EPOCH_NS + np.arange(20) * 7_000_000, [0x201] * 20))
    clock = Clock(gateway({"snr": 0})).play(came, 7)
    assert wire(clock.frames) == wire(came)


def test_other_frames_pass_at_once() -> None:
    foreign = other_frames(EPOCH_NS + np.arange(40) * 7_000_000, [0x201] * 40)
    clock = Clock(gateway({"snr": 60})).play(merged(stream(4), foreign)).rest()
    passed = clock.frames.can_id == 0x201
    assert wire(clock.frames.select(passed)) == wire(foreign)
    np.testing.assert_array_equal(clock.times_ns[passed], foreign.stamp_ns - EPOCH_NS)


def test_as_many_are_missed_as_by_whole_scans() -> None:
    came = stream(40)
    after = scans(Clock(gateway({"missed": 100})).play(came, 20).rest().frames)[1:]
    before = scans(came)[1:]
    keys = [DrawKey(1, "radar", number) for number in range(1, 40)]
    whole = [
        radar.apply(radar.draw("missed", 100, key), scan)
        for key, scan in zip(keys, before, strict=True)
    ]
    missed = sum(map(len, before)) - sum(map(len, whole))
    assert missed > 200
    assert sum(map(len, before)) - sum(map(len, after)) == pytest.approx(missed, rel=0.2)


def test_weak_echoes_are_missed_rather_than_strong_ones() -> None:
    came = stream(40)
    after = scans(Clock(gateway({"missed": 60})).play(came, 20).rest().frames)[1:]
    echoes = [radar.echo_db(np.hypot(s.x, s.y), s.rcs) for s in (*scans(came)[1:], *after)]
    half = len(echoes) // 2
    assert np.median(np.concatenate(echoes[half:])) > np.median(np.concatenate(echoes[:half])) + 1


def test_jitter_scatters_as_much_as_the_sensors_accuracy_says() -> None:
    came = stream(40)
    after = scans(Clock(gateway({"jitter": 100})).play(came, 20).rest().frames)[1:]
    pairs = zip(after, scans(came)[1:], strict=True)
    moved = np.array([(np.hypot(a.x, a.y), np.hypot(b.x, b.y)) for a, b in pairs])
    near = ARS408.is_near(moved[:, 1])
    scatter = (moved[:, 0] - moved[:, 1])[near].std()
    assert scatter == pytest.approx(radar.std_growth(10) * ARS408.near_range_std_m, rel=0.3)


def test_ghosts_are_announced_and_stand_in_their_place() -> None:
    came = stream(30)
    after = scans(Clock(gateway({"ghosts": 100})).play(came, 20).rest().frames)[1:]
    before = scans(came)[1:]
    more = np.array([len(a) - len(b) for a, b in zip(after, before, strict=True)])
    assert set(more.tolist()) == {0, 1, 2, 3, 4}
    for scan in after:
        distance = np.hypot(scan.x, scan.y)
        for part in (distance[: scan.near], distance[scan.near :]):
            assert (np.diff(part) > -0.5).all()


def test_ghosts_take_the_place_of_the_last_clusters_where_a_cycle_is_full() -> None:
    came = stream(10, clusters=125)
    after = scans(Clock(gateway({"ghosts": 100})).play(came, 20).rest().frames)[1:]
    assert {len(scan) for scan in after} == {125}
    before = scans(came)[1:]
    assert any((a.x[:80] != b.x[:80]).any() for a, b in zip(after, before, strict=True))


@pytest.mark.parametrize("levels", [{"blockage": 60}, {"snr": 60, "blockage": 10}, {"drop": 5}])
def test_what_needs_whole_scans_gets_them(levels: dict[str, float]) -> None:
    clock = Clock(gateway(levels)).play(stream(4)).rest()
    starts = clock.frames.can_id == 0x600
    latency_ns = clock.times_ns[starts] - (clock.frames.stamp_ns[starts] - EPOCH_NS)
    assert (latency_ns > 0).all()


def test_the_seed_repeats_a_run_and_the_batches_do_not_matter() -> None:
    came = stream(5)
    first, again, other = (
        wire(Clock(gateway({"snr": 60}, seed)).play(came, batch).rest().frames)
        for seed, batch in ((1, 1), (1, 50), (2, 1))
    )
    assert first == again != other


def test_a_repeated_frame_is_not_sent_twice() -> None:
    came = stream(3)
    rows = np.repeat(np.arange(len(came)), np.where(came.can_id == 0x600, 1, 2))
    clock = Clock(gateway({"missed": 60})).play(came.select(rows)).rest()
    assert all(scan.duplicates == scan.frames_lost == 0 for scan in scans(clock.frames)[1:])


def test_the_end_leaves_no_half_scan_on_the_wire() -> None:
    came = stream(4)
    core = gateway({"missed": 60})
    clock = Clock(core).play(came.select(slice(0, 200)))
    core.finish()
    clock.play(came.select(slice(200, None))).finish()
    after = scans(clock.frames)
    assert len(after) == 2
    assert all(scan.frames_lost == 0 for scan in after)
