from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from statistics import NormalDist

import numpy as np
import pytest
from degrade_scans import QUALITY, make_scan, real_scans, scans
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc.errors import InputError
from models.degrade import radar
from models.degrade.draw import DrawKey
from models.sensor import ARS408

KEY = DrawKey(1, "radar", 5)
FIELDS = [field.name for field in ARS408.grid]
CELL = math.hypot(0.2, 0.2)


def degrade(kind, level, scan, key=KEY, **options):
    return radar.apply(radar.draw(kind, level, key, **options), scan)


def keys(count):
    return [DrawKey(3, "radar", sequence) for sequence in range(count)]


def assert_same(first, second):
    assert first.arrays().keys() == second.arrays().keys()
    for name, array in first.arrays().items():
        assert array.tobytes() == second.arrays()[name].tobytes(), name


def assert_sendable(scan, quality):
    """Check that an ARS 408 could have sent this scan."""
    n = len(scan)
    assert n <= (125 if quality else 250)
    assert scan.near + scan.far == n
    np.testing.assert_array_equal(scan.id, np.arange(n))
    for field in ARS408.grid:
        values = getattr(scan, field.name)
        assert values.dtype == np.float32
        np.testing.assert_array_equal(values, ARS408.to_grid(field.name, values).astype(np.float32))
    ranges = np.hypot(scan.x.astype(float), scan.y)
    for part in (ranges[: scan.near], ranges[scan.near :]):
        assert (np.diff(part) > -2 * CELL).all()
    for name, array in scan.arrays().items():
        assert len(array) == n, name
        assert array.dtype == (np.float32 if name in FIELDS else np.uint8), name


@pytest.mark.parametrize("kind", radar.KINDS)
def test_level_0_is_the_identity(kind, data):
    for scan in real_scans(data)[:3]:
        assert degrade(kind, 0, scan) is scan


@settings(max_examples=150, deadline=None)
@given(
    scans(),
    st.sampled_from(radar.KINDS),
    st.floats(0, 100, exclude_min=True),
    st.sampled_from([0.0, 10.0, 20.0, 300.0]),
    st.sampled_from(["frozen", "consistent"]),
    st.integers(0, 1000),
)
def test_what_leaves_could_have_come_from_the_sensor(scan, kind, level, drop, quality, sequence):
    before = {name: array.copy() for name, array in scan.arrays().items()}
    degradation = radar.draw(
        kind, level, DrawKey(2, "radar", sequence), snr_drop_db=drop, quality=quality
    )
    result = radar.apply(degradation, scan)
    assert_sendable(result, scan.pdh0 is not None)
    assert result.arrays().keys() == scan.arrays().keys()
    assert_same(result, radar.apply(degradation, scan))
    for name, array in scan.arrays().items():
        np.testing.assert_array_equal(array, before[name])


@pytest.mark.parametrize("kind", radar.KINDS)
def test_real_scans_stay_sendable_and_headers_stay(kind, data):
    for scan in real_scans(data)[:10]:
        result = degrade(kind, 70, scan)
        assert_sendable(result, quality=True)
        assert (result.stamp_ns, result.sequence, result.meas_counter) == (
            scan.stamp_ns, scan.sequence, scan.meas_counter,
        )  # fmt: skip


@pytest.mark.parametrize("kind", radar.KINDS)
def test_parameters_are_plain_data_and_depend_on_the_key_alone(kind):
    degradation = radar.draw(kind, 40, KEY)
    record = json.loads(json.dumps(asdict(degradation)))
    record["ghosts"] = tuple(radar.Ghost(**ghost) for ghost in record["ghosts"])
    assert radar.RadarDegradation(**record) == degradation == radar.draw(kind, 40, KEY)
    forwards = [radar.draw(kind, 40, key) for key in keys(20)]
    backwards = [radar.draw(kind, 40, key) for key in reversed(keys(20))]
    assert forwards == backwards[::-1]


@pytest.mark.parametrize("level", [float("nan"), -1, 101, 1e6, float("inf")])
def test_impossible_levels_are_refused(level):
    with pytest.raises(InputError, match="0 to 100"):
        radar.draw("snr", level, KEY)


def test_other_requests_are_refused():
    with pytest.raises(InputError, match="no such degradation"):
        radar.draw("blur", 10, KEY)
    with pytest.raises(InputError, match="out of range"):
        radar.draw("snr", 10, KEY, snr_drop_db=-1)
    with pytest.raises(InputError, match="frozen or consistent"):
        radar.draw("snr", 10, KEY, quality="thawed")
    with pytest.raises(InputError, match="object mode"):
        degrade("snr", 0, replace(make_scan([1.0], 0.0), mode="object"))


# Missed detections: the radar equation


@pytest.mark.parametrize("margin_db", [0.0, 3.0, 8.0, 13.0])
@pytest.mark.parametrize("level", [20, 60, 100])
def test_drop_probability_follows_the_margin(margin_db, level):
    """Within 4 standard errors of Φ((1 - 10^((margin - drop)/10)) / N)."""
    deviates = np.random.default_rng(0).standard_normal(40_000)
    drop = level / 10
    missed = radar.is_missed(np.full(40_000, margin_db), level, drop, deviates).mean()
    expected = NormalDist().cdf((1 - 10 ** ((margin_db - drop) / 10)) / (level / 100))
    error = math.sqrt(max(expected * (1 - expected), 1e-4) / 40_000)
    assert abs(missed - expected) < 4 * error


def test_drop_probability_holds_end_to_end():
    """One weak cluster at the floor beside strong ones, 2,000 scans."""
    weakest = make_scan([99.8, 20.0, 30.0], -0.1, rcs=[-0.5, 25.0, 25.0])
    echo = radar.echo_db(np.hypot(weakest.x, weakest.y), weakest.rcs)[0]
    assert echo == pytest.approx(-80.47, abs=0.05)
    gone = [np.max(degrade("missed", 50, weakest, key).x) < 99.5 for key in keys(2000)]
    expected = NormalDist().cdf((1 - 10**-0.5) / 0.5)
    assert np.mean(gone) == pytest.approx(expected, abs=4 * math.sqrt(expected / 2000))


@given(st.floats(0.2, 1e5), st.floats(-64, 63.5))
def test_doubling_the_range_costs_12_db(distance, rcs):
    near, far = radar.echo_db(np.array([distance, 2 * distance]), np.full(2, rcs))
    assert near - far == pytest.approx(40 * math.log10(2), abs=1e-9)


def test_the_threshold_is_the_weakest_echo_or_the_typical_floor():
    assert radar.threshold_db(np.array([-90.0, -50.0])) == -90.0
    assert radar.threshold_db(np.array([-30.0])) == ARS408.detection_floor_db
    assert radar.threshold_db(np.array([])) == ARS408.detection_floor_db


def test_a_strong_lone_cluster_survives():
    scan = make_scan([15.0], 0.1, rcs=20.0)
    assert all(len(degrade("missed", 100, scan, key)) == 1 for key in keys(200))


def test_real_scans_lose_more_at_each_level(data):
    made = real_scans(data)
    total = sum(map(len, made))
    lost = []
    for level in (1, 20, 40, 60, 80, 100):
        kept = [
            degrade("missed", level, scan, DrawKey(3, "radar", k)) for k, scan in enumerate(made)
        ]
        lost.append(1 - sum(map(len, kept)) / total)
    assert (np.diff(lost) > 0).all()
    assert lost[0] < 0.02
    assert 0.05 < lost[-1] < 0.4


# Jitter: the Cramér–Rao bound


def test_the_measured_spread_has_slope_minus_one_twentieth():
    """Own and added variance together: log10 σ against SNR in dB."""
    drops = np.arange(0.0, 41.0, 5.0)
    total = [math.hypot(1.0, radar.std_growth(drop)) for drop in drops]
    slope = np.polyfit(-drops, np.log10(total), 1)[0]
    assert slope == pytest.approx(-1 / 20, rel=1e-12)
    assert math.hypot(1.0, radar.std_growth(10)) == pytest.approx(math.sqrt(10))
    assert radar.std_growth(0) == radar.std_growth(-300) == 0


@pytest.mark.parametrize(("distance", "azimuth"), [(40.0, 0.0), (40.0, 45.0), (90.0, 5.0)])
def test_jitter_has_the_sensors_spread_times_its_growth(distance, azimuth):
    """Standard deviations over 50 × 200 clusters, within 4 standard errors (and the grid)."""
    angle = math.radians(azimuth)
    x, y = distance * math.cos(angle), distance * math.sin(angle)
    scan = make_scan(np.full(200, x), y, vx=-10 * math.cos(angle), vy=-10 * math.sin(angle))
    drop, grid = 20.0, 12**-0.5
    moved = [degrade("jitter", 100, scan, key, snr_drop_db=drop) for key in keys(50)]
    along = np.concatenate([m.x * math.cos(angle) + m.y * math.sin(angle) for m in moved])
    across = np.concatenate([-m.x * math.sin(angle) + m.y * math.cos(angle) for m in moved])
    radial = np.concatenate([m.vx * math.cos(angle) + m.vy * math.sin(angle) for m in moved])
    sideways = np.concatenate([-m.vx * math.sin(angle) + m.vy * math.cos(angle) for m in moved])
    growth = radar.std_growth(drop)
    bound = 4 / math.sqrt(2 * 10_000) + 0.02
    turned = growth * float(ARS408.azimuth_std(distance, angle)) * distance
    bent = turned**2 / distance / 2  # the arc's sagitta shows along the line of sight
    expected = math.hypot(growth * float(ARS408.range_std(distance)), 0.2 * grid, bent * 1.5)
    assert along.std() == pytest.approx(expected, rel=bound)
    assert across.std() == pytest.approx(math.hypot(turned, 0.2 * grid), rel=bound)
    fast = math.hypot(growth * ARS408.velocity_std, 0.25 * grid)
    assert radial.std() == pytest.approx(fast, rel=bound)
    assert sideways.std() < 0.15


def test_jitter_alone_keeps_every_cluster(data):
    for scan in real_scans(data)[:5]:
        result = degrade("jitter", 100, scan)
        assert len(result) == len(scan)
        assert sorted(result.rcs) == sorted(scan.rcs)


# Ghosts


def test_ghost_counts_are_uniform_on_0_to_4():
    counts = np.bincount([len(radar.draw("ghosts", 30, key).ghosts) for key in keys(5000)])
    assert len(counts) == 5
    chi_square = ((counts - 1000) ** 2 / 1000).sum()
    assert chi_square < 18.47  # 1 in 1,000 at 4 degrees of freedom


def ghosts_of(scan, count=300, level=50):
    """Return x, y, vx, vy, rcs of the ghosts over many scans: what was not there before."""
    before = {tuple(row) for row in zip(scan.x, scan.y, strict=True)}
    found = []
    for key in keys(count):
        result = degrade("ghosts", level, scan, key)
        rows = zip(result.x, result.y, result.vx, result.vy, result.rcs, strict=True)
        found += [row for row in rows if (row[0], row[1]) not in before]
    return np.array(found, float).T


def test_ghosts_lie_inside_the_field_of_view_and_the_scans_reach():
    scan = make_scan([5.0, 60.0, 150.0], 0.1, rcs=[0.0, 10.0, 20.0])
    x, y, _, _, rcs = ghosts_of(scan)
    ranges = np.hypot(x, y)
    assert ranges.max() <= 160.0 + 2 * CELL
    limits = np.select([ranges < 10 - CELL, ranges < 100 - CELL], [60.0, 40.0], 9.0)
    limits[np.abs(ranges - 10) <= CELL] = 60.0
    limits[np.abs(ranges - 100) <= CELL] = 40.0
    assert (np.abs(np.degrees(np.arctan2(y, x))) <= limits + np.degrees(CELL / ranges)).all()
    assert set(rcs) == {0.0, 10.0, 20.0}
    assert np.mean(rcs == 0.0) > np.mean(rcs == 20.0)
    statistic = np.abs(np.sort(ranges) / 160 - np.linspace(0, 1, len(ranges))).max()
    assert statistic < 1.95 / math.sqrt(len(ranges))


def test_ghosts_move_along_their_line_of_sight():
    """A stationary world seen from a car at 15 m/s: v_r = -15 cos(azimuth), so v_comp = 0."""
    scan = make_scan([10.0, 30.0, 80.0], [0.1, 2.1, 4.1], vx=-15.0)
    x, y, vx, vy, _ = ghosts_of(scan)
    ranges = np.hypot(x, y)
    far = ranges > 5  # nearer, the grid turns the line of sight itself
    across = (-vx * y + vy * x)[far] / ranges[far]
    radial = ((vx * x + vy * y) / ranges)[far]
    assert np.abs(across).max() < 0.25 + 15 * CELL / 5
    compensated = radial + 15.0 * x[far] / ranges[far]
    assert np.abs(compensated).max() < 0.25 + 15 * CELL / 5


def test_ghost_quality_is_plausible(data):
    scan = real_scans(data)[0]
    short = replace(
        scan, near=100, far=0, **{name: array[:100] for name, array in scan.arrays().items()}
    )
    for key in keys(50):
        result = degrade("ghosts", 50, short, key)
        for name in QUALITY:
            if name != "invalid_state":
                assert set(getattr(result, name)) <= set(getattr(short, name))
        new = np.bincount(result.invalid_state, minlength=18) - np.bincount(
            short.invalid_state, minlength=18
        )
        assert set(np.flatnonzero(new)) <= set(radar.GHOST_INVALID_STATES)
        assert new.sum() == len(result) - 100 <= 4


def test_a_full_list_stays_full_and_loses_its_end():
    scan = make_scan(np.arange(250) * 0.4 + 2, 0.1)
    for key in keys(20):
        ghosts = radar.draw("ghosts", 50, key).ghosts
        result = degrade("ghosts", 50, scan, key)
        assert len(result) == 250
        if not ghosts:
            assert result.x.max() == scan.x.max()


def test_near_and_far_lists_stay_apart():
    scan = make_scan([10.0, 20.0, 60.0, 5.0, 120.0, 200.0], 0.1, near=3)
    for key in keys(30):
        result = degrade("ghosts", 50, scan, key)
        assert result.x[: result.near].max() <= 60.0 + CELL
        assert {10.0, 20.0, 60.0} <= set(np.round(result.x[: result.near], 1).tolist())
        assert {5.0, 120.0, 200.0} <= set(np.round(result.x[result.near :], 1).tolist())


# Quality


def test_frozen_quality_stays_and_consistent_quality_follows(data):
    scan = real_scans(data)[0]
    frozen = degrade("jitter", 100, scan)
    assert sorted(frozen.x_rms) == sorted(scan.x_rms)
    previous = None
    for level in (0.001, 30, 60, 100):
        result = degrade("jitter", level, scan, quality="consistent")
        assert set(result.pdh0) <= {1, 3, 6}
        means = [getattr(result, name).mean() for name in ("x_rms", "y_rms", "vx_rms", "pdh0")]
        assert set(result.vy_rms) == set(scan.vy_rms)
        if previous is None:
            assert sorted(result.x_rms) == sorted(scan.x_rms)
            assert sorted(result.pdh0) == sorted(scan.pdh0)
        else:
            assert (np.array(means) >= previous).all()
        previous = np.array(means)
    table = 0.005 * 2000 ** (np.arange(31) / 30)
    ratio = table[np.sort(result.x_rms)[-100:]] / table[np.sort(scan.x_rms)[-100:]]
    assert ratio == pytest.approx(math.sqrt(10), rel=0.13)  # half a step of the table


# Extremes


@pytest.mark.parametrize("kind", radar.KINDS)
@pytest.mark.parametrize("level", [1e-9, 50, 100])
@pytest.mark.parametrize("drop", [0.0, 10.0, 300.0])
@pytest.mark.parametrize(
    "scan",
    [
        make_scan([], []),
        make_scan([0.0], 0.0),
        make_scan(np.full(1000 // 4, 30.0), 0.0),
        make_scan([1e6, 1e6], [1e6, -1e6], vx=1e6, vy=-1e6, rcs=[1e3, -1e3]),
        make_scan([3e38, -3e38], 3e38, vx=3e38, rcs=3e38),
        make_scan([-50.0, -60.0], 80.0),
    ],
    ids=["empty", "at the antenna", "equal", "1e6 m", "float32 limit", "behind"],
)
def test_extremes_stay_on_the_grid(kind, level, drop, scan):
    result = degrade(kind, level, scan, snr_drop_db=drop)
    assert_sendable(result, quality=False)


def test_values_that_are_no_numbers_are_masked_and_counted():
    bad = [math.nan, math.inf, -math.inf]
    scan = make_scan([10.0, *bad, 50.0], [0.1, 0.1, *bad[:2], 0.1], vx=[1, -math.inf, 0, 0, 0])
    for kind in radar.KINDS:
        for key in keys(5):
            result = degrade(kind, 1, scan, key)
            assert_sendable(result, quality=False)
            assert result.frames_lost == 3
