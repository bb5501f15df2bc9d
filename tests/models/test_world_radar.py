"""The simulated radar: the sensor's limits, the radar equation, and the look of real scans."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.ars408 import ScanAssembler
from drivers.scan import MotionInput, RadarScan
from models.sensor import ARS408
from models.world.beam import DETECTION_DB, FAR, NEAR, noise_db
from models.world.echoes import measure
from models.world.objects import Kind, Objects
from models.world.points import Echoes, Motion, Points
from models.world.radar import WorldRadar
from models.world.reflectors import reflectors
from models.world.road import EPOCH_NS, World
from models.world.sight import Antenna, look


@pytest.fixture(scope="module")
def radar() -> WorldRadar:
    return WorldRadar(World(7, 60.0))


@pytest.fixture(scope="module")
def scans(radar: WorldRadar) -> list[RadarScan]:
    return [radar.scan(sequence) for sequence in range(0, 820, 20)]


def polar(scan: RadarScan) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    x, y = scan.x.astype(float), scan.y.astype(float)
    return np.hypot(x, y), np.arctan2(y, x)


def same(one: RadarScan, other: RadarScan) -> bool:
    return one.stamp_ns == other.stamp_ns and all(
        np.array_equal(a, b)
        for a, b in zip(one.arrays().values(), other.arrays().values(), strict=True)
    )


def test_a_scan_is_the_same_whoever_asks_and_in_whatever_order() -> None:
    one, other = WorldRadar(World(3, 5.0)), WorldRadar(World(3, 5.0))
    iterated = list(islice(one.scans(), 20))
    assert same(other.scan(19), iterated[19])
    assert same(other.scan(4), iterated[4])
    assert same(next(one.scans()), iterated[0])
    assert not same(WorldRadar(World(4, 5.0)).scan(4), iterated[4])


def test_cycles_come_every_72_ms_with_a_small_jitter(radar: WorldRadar) -> None:
    stamps = np.array([radar.scan(k).stamp_ns for k in range(5)]) / 1e9
    assert np.allclose(np.diff(stamps), 0.072, atol=0.0021)
    assert len(set(np.round(np.diff(stamps), 9))) > 1
    counters = [radar.scan(k).meas_counter for k in range(5)]
    assert counters == [0, 2, 4, 6, 8]
    assert len(list(WorldRadar(World(1, 1.0)).scans())) == 14


def test_values_lie_on_the_grid_of_the_bus(scans: list[RadarScan]) -> None:
    for scan in scans:
        for name in ("x", "y", "vx", "vy", "rcs"):
            values = getattr(scan, name)
            assert values.dtype == np.float32
            assert np.array_equal(values, ARS408.to_grid(name, values).astype(np.float32))
        assert set(np.unique(scan.pdh0)) <= {1, 3, 6}
        assert scan.dyn_prop.max() <= 7


def test_lists_are_near_then_far_each_by_range_numbered_and_capped(
    scans: list[RadarScan],
) -> None:
    for scan in scans:
        assert scan.near + scan.far == len(scan) <= 125
        assert np.array_equal(scan.id, np.arange(len(scan)))
        r, _ = polar(scan)
        rounding = 0.3
        for part in (r[: scan.near], r[scan.near :]):
            assert np.all(np.diff(part) > -rounding)
    assert max(len(scan) for scan in scans) == 125


def test_clusters_lie_in_the_fields_of_view(scans: list[RadarScan]) -> None:
    for scan in scans:
        r, azimuth = polar(scan)
        degrees = np.degrees(np.abs(azimuth))
        near = np.arange(len(scan)) < scan.near
        known = scan.dyn_prop != 4
        assert np.all(r[near] < 131)
        assert np.all(r[~near] < 259)
        assert np.all(degrees[~near & known & (r > 20)] < 9.5)
        assert np.all(degrees[near & known & (r > 10)] < 61.5)
        assert np.all(scan.invalid_state[~known] == 7)
        assert np.all(scan.vx[~known] == 0)


def test_without_quality_up_to_250_clusters_and_no_quality_fields() -> None:
    world = World(7, 60.0)
    with_quality, without = WorldRadar(world), WorldRadar(world, quality=False)
    scans = [(with_quality.scan(k), without.scan(k)) for k in range(0, 800, 160)]
    assert any(len(plain) > 125 for _, plain in scans)
    for rich, plain in scans:
        assert plain.pdh0 is None
        assert plain.x_rms is None
        assert len(plain) <= 250
        assert np.array_equal(plain.x[: rich.near], rich.x[: rich.near])


@pytest.mark.parametrize(("sensor_id", "quality"), [(0, True), (3, True), (1, False)])
def test_can_frames_assemble_back_to_the_scans_without_a_loss(
    sensor_id: int, quality: bool
) -> None:
    radar = WorldRadar(World(5, 2.3), sensor="front", sensor_id=sensor_id, quality=quality)
    assembler = ScanAssembler({sensor_id: "front"})
    items = []
    last_ns = 0
    counts: dict[int, int] = {}
    for frames in radar.frames():
        assert frames.stamp_source == "simulated"
        assert np.all(np.diff(frames.stamp_ns) >= 0)
        assert frames.stamp_ns[0] >= last_ns
        last_ns = int(frames.stamp_ns[-1])
        for can_id in frames.can_id.tolist():
            counts[can_id] = counts.get(can_id, 0) + 1
        items += assembler.feed(frames)
    items += assembler.flush()
    scans = [item for item in items if isinstance(item, RadarScan)]
    for assembled, sent in zip(scans, radar.scans(), strict=True):
        assert same(assembled, sent)
        assert (assembled.near, assembled.far) == (sent.near, sent.far)
        assert assembled.meas_counter == sent.meas_counter
        assert not assembled.frames_lost
        assert not assembled.cycles_lost
        assert not assembled.strays
    assert assembler.strays == 0
    shift = 0x10 * sensor_id
    assert counts[0x201 + shift] == counts[0x700 + shift] == 3
    assert counts[0x300 + shift] == counts[0x301 + shift] == 47


def test_motion_frames_tell_the_ego_motion() -> None:
    radar = WorldRadar(World(9, 2.0))
    assembler = ScanAssembler({0: "radar"})
    items = [item for frames in radar.frames() for item in assembler.feed(frames)]
    inputs = [item for item in items if isinstance(item, MotionInput) and item.yaw_rate is not None]
    assert len(inputs) > 30
    for item in inputs[5:]:
        ego = radar.world.ego((item.stamp_ns - EPOCH_NS) / 1e9)
        assert item.speed == pytest.approx(ego.speed, abs=0.05)
        assert item.yaw_rate == pytest.approx(np.degrees(ego.yaw_rate), abs=0.5)


def test_what_stands_closes_in_with_minus_ego_speed_times_cosine(radar: WorldRadar) -> None:
    for t_s in (3.0, 20.0, 41.0):
        antenna, points = radar.antenna(t_s), radar.points(t_s)
        standing = points.motion == Motion.STANDING
        expected = -antenna.ahead * np.cos(points.azimuth) - antenna.left * np.sin(points.azimuth)
        assert standing.sum() > 100
        assert np.allclose(points.speed[standing], expected[standing])


def test_clusters_that_stand_show_the_ego_motion(radar: WorldRadar, scans: list[RadarScan]) -> None:
    for scan in scans:
        antenna = radar.antenna((scan.stamp_ns - EPOCH_NS) / 1e9)
        standing = np.isin(scan.dyn_prop, (1, 3)) & (np.abs(scan.y) < scan.x)
        error = scan.vx[standing] + antenna.ahead - antenna.yaw_rate * scan.y[standing]
        assert np.median(np.abs(error)) < 0.25


def test_doubling_the_range_costs_12_db() -> None:
    r, ahead = np.array([20.0, 40.0, 80.0]), np.zeros(3)
    for beam in (NEAR, FAR):
        assert np.allclose(np.diff(noise_db(beam, r, ahead)), 40 * np.log10(2))


def target(r: float, rcs_db: float, steady: float, n: int, seed: int = 0) -> Points:
    """Return n equal targets on boresight, apart in speed so that none hides another."""
    rng = np.random.default_rng(seed)
    return Points(
        r=np.full(n, r),
        azimuth=np.zeros(n),
        speed=2.0 * np.arange(n),
        amplitude=np.full(n, 10 ** (rcs_db / 20)),
        steady=np.full(n, steady),
        turn=rng.uniform(0, 2 * np.pi, (n, 3)),
        motion=np.zeros(n, np.uint8),
        chance=rng.random(n),
    )


def detected(points: Points, seed: int) -> Echoes:
    echoes = measure(points, NEAR, ARS408, np.random.default_rng(seed))
    return echoes[echoes.motion == Motion.STANDING]


def test_snr_falls_and_echoes_spread_as_the_radar_equation_says() -> None:
    near, far = (detected(target(r, 10.0, 1.0, 800), 1) for r in (55.0, 110.0))
    assert len(near) == len(far) == 800
    assert np.median(near.snr) - np.median(far.snr) == pytest.approx(12.04, abs=0.4)
    growth = np.std(far.r) / np.std(near.r)
    assert 1.3 < growth < 10 ** (12.04 / 20)


def test_detection_probability_of_a_fluctuating_target_is_swerlings() -> None:
    r = 110.0
    mean_db = float(noise_db(NEAR, np.array(r), np.array(0.0))) + 22.0
    found = sum(len(detected(target(r, mean_db, 0.0, 400, seed), seed)) for seed in range(10))
    swerling_1 = np.exp(-(10 ** (DETECTION_DB / 10)) / (1 + 10 ** (22.0 / 10)))
    assert found / 4000 == pytest.approx(swerling_1, abs=0.06)


def test_two_targets_in_one_cell_are_one_echo() -> None:
    one = target(40.0, 10.0, 1.0, 1)
    pair = Points(*(np.repeat(getattr(one, name), 2, axis=0) for name in Points.__slots__))
    close = replace(pair, r=np.array([40.0, 40.1]))
    apart = replace(pair, r=np.array([40.0, 42.0]))
    assert len(detected(close, 0)) == 1
    assert len(detected(apart, 0)) == 2


def test_a_standing_radar_sees_the_same_twice_and_a_moving_one_does_not() -> None:
    def strongest(radar: WorldRadar, t_s: float) -> NDArray[np.float64]:
        points = radar.points(t_s)
        return np.sort(points.amplitude[points.motion == Motion.STANDING])[-50:]

    world = next(w for w in (World(seed, 120.0) for seed in range(50)) if w.drive.stops)
    radar = WorldRadar(world)
    t = np.arange(0.0, 119.0, 0.5)
    speed = np.array([world.ego(float(s)).speed for s in t])
    stood = t[(speed == 0) & (np.roll(speed, -1) == 0)]
    assert len(stood) > 2
    middle = float(stood[len(stood) // 2])
    assert np.allclose(radar.points(middle).turn[:100], radar.points(middle + 0.072).turn[:100])
    moving = float(t[speed.argmax()])
    assert not np.allclose(strongest(radar, moving), strongest(radar, moving + 0.5))


def boxes(*placed: tuple[Kind, float, float]) -> Objects:
    """Return standing boxes: kind, distance ahead of the origin, width; m."""
    n = len(placed)
    ahead, width = (np.array([box[i] for box in placed], float) for i in (1, 2))
    zero = np.zeros(n)
    return Objects(
        kind=np.array([box[0] for box in placed], np.uint8),
        s=ahead,
        x=ahead,
        y=zero,
        z=zero,
        heading=zero,
        length=np.full(n, 0.5),
        width=width,
        height=np.full(n, 3.0),
        vx=zero,
        vy=zero,
        look=np.arange(n, dtype=np.uint32)[::-1],
    )


@pytest.mark.parametrize(
    ("screen", "least", "most"), [(Kind.BUILDING, 0.05, 0.3), (Kind.CAR, 0.3, 0.7)]
)
def test_houses_shadow_what_lies_behind_and_vehicles_let_some_pass(
    screen: Kind, least: float, most: float
) -> None:
    antenna = Antenna(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def seen(objects: Objects) -> float:
        made = reflectors(objects.kind, objects.length, objects.width, objects.look)
        points = look(antenna, made.placed(objects), objects, len(objects))
        return float(points.amplitude[np.isclose(points.r, 40.0)][0])

    hidden = seen(boxes((screen, 20.0, 8.0), (Kind.SIGN, 40.0, 0.1)))
    in_the_open = seen(boxes((screen, 60.0, 8.0), (Kind.SIGN, 40.0, 0.1)))
    assert least < hidden / in_the_open < most


def test_simulated_scans_look_like_real_ones(data: Path) -> None:
    recorded = [np.load(path)["points"] for path in sorted((data / "radar").rglob("scene-*.npz"))]
    real = np.concatenate(recorded).astype(float)
    x, y, dyn, rcs = real[:, 0], real[:, 1], real[:, 3], real[:, 5]
    worlds = (WorldRadar(World(seed, 40.0)) for seed in range(200, 224))
    simulated = [radar.scan(k) for radar in worlds for k in (90, 290, 490)]
    sx, sy, sdyn, srcs = (
        np.concatenate([getattr(scan, name) for scan in simulated]).astype(float)
        for name in ("x", "y", "dyn_prop", "rcs")
    )
    quantiles = [5, 25, 50, 75, 95]
    r, sr = np.hypot(x, y), np.hypot(sx, sy)
    assert np.percentile(srcs, quantiles) == pytest.approx(np.percentile(rcs, quantiles), abs=2.5)
    assert np.percentile(sr, quantiles) == pytest.approx(np.percentile(r, quantiles), rel=0.3)
    edge, real_edge = (
        np.percentile(a - 40 * np.log10(b), [1, 5, 25]) for a, b in ((srcs, sr), (rcs, r))
    )
    assert edge == pytest.approx(real_edge, abs=4.0)
    for value in (1, 3):
        assert np.mean(sdyn == value) == pytest.approx(np.mean(dyn == value), abs=0.12)
