"""Jammers and disturbed propagation."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from degrade_scans import make_scan, real_scans, scans
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc.errors import InputError
from drivers.scan import RadarState
from models.degrade import jammer, propagation
from models.degrade.clusters import Clusters
from models.degrade.draw import DrawKey
from models.sensor import ARS408

KINDS = [(module, kind) for module in (jammer, propagation) for kind in module.KINDS]
CELL = math.hypot(0.2, 0.2)


def degrade(module, kind, level, scan, key=DrawKey(1, "radar", 50)):  # noqa: B008
    return module.apply(module.draw(kind, level, key), scan)


def fan():
    """Return 241 equal clusters at 40 m, from -60° to 60°, each 3 dB over the threshold."""
    azimuth = np.radians(np.linspace(-60, 60, 241))
    rcs = ARS408.detection_floor_db + 40 * math.log10(40) + 3
    return make_scan(40 * np.cos(azimuth), 40 * np.sin(azimuth), rcs=rcs)


@pytest.mark.parametrize(("module", "kind"), KINDS)
def test_level_0_is_the_identity_and_parameters_are_plain_data(module, kind):
    scan = fan()
    assert degrade(module, kind, 0, scan) is scan
    drawn = module.draw(kind, 70, DrawKey(1, "radar", 50))
    assert type(drawn)(**json.loads(json.dumps(asdict(drawn)))) == drawn
    assert drawn == module.draw(kind, 70, DrawKey(1, "radar", 50))


@pytest.mark.parametrize(("module", "kind"), KINDS)
def test_bad_requests_are_refused(module, kind):
    with pytest.raises(InputError, match="0 to 100"):
        module.draw(kind, math.nan, DrawKey(1, "radar", 0))
    with pytest.raises(InputError, match="no such degradation"):
        module.draw("snr", 10, DrawKey(1, "radar", 0))
    with pytest.raises(InputError, match="object mode"):
        degrade(module, kind, 50, replace(fan(), mode="object"))


@settings(max_examples=100, deadline=None)
@given(
    scans(),
    st.sampled_from(KINDS),
    st.floats(0, 100, exclude_min=True),
    st.integers(0, 300),
    st.sampled_from([1.0, 1e6, math.nan, math.inf]),
)
def test_what_leaves_could_have_come_from_the_sensor(scan, which, level, sequence, scale):
    module, kind = which
    if len(scan):
        x = scan.x.copy()
        x[0] = x[0] if scale == 1 else scale
        scan = replace(scan, x=x)
    drawn = module.draw(kind, level, DrawKey(2, "radar", sequence))
    result = module.apply(drawn, scan)
    if result is scan:
        return
    n = len(result)
    assert n <= (250 if scan.pdh0 is None else 125)
    assert result.near + result.far == n
    np.testing.assert_array_equal(result.id, np.arange(n))
    for field in ARS408.grid:
        values = getattr(result, field.name)
        np.testing.assert_array_equal(values, ARS408.to_grid(field.name, values).astype(np.float32))
    ranges = np.hypot(result.x.astype(float), result.y)
    for part in (ranges[: result.near], ranges[result.near :]):
        assert (np.diff(part) > -2 * CELL).all()
    again = module.apply(drawn, scan)
    for name, array in result.arrays().items():
        assert array.tobytes() == again.arrays()[name].tobytes()


@pytest.mark.parametrize(
    ("module", "kind", "sign"),
    [
        (jammer, "noise_jam", -1),
        (propagation, "blockage", -1),
        (jammer, "interference", 1),
        (propagation, "multipath", 1),
    ],
)
def test_real_scans_lose_or_gain_more_at_higher_levels(module, kind, sign, data):
    made = [
        replace(scan, **{name: array[:90] for name, array in scan.arrays().items()}, near=90)
        for scan in real_scans(data)
    ]
    counts = [
        sum(
            len(module.apply(module.draw(kind, level, DrawKey(1, "radar", k)), scan))
            for k, scan in enumerate(made)
        )
        for level in (0, 10, 40, 100)
    ]
    assert (sign * np.diff(counts) > 0).all()


# Jammers


def test_noise_blinds_the_sector_it_comes_from_and_no_other():
    scan = fan()
    drawn = jammer.draw("noise_jam", 100, DrawKey(1, "radar", 50))
    left = jammer.apply(drawn, scan)
    away = np.abs(np.degrees(np.arctan2(left.y, left.x)) - drawn.azimuth_deg)
    before = np.abs(np.degrees(np.arctan2(scan.y, scan.x)) - drawn.azimuth_deg)
    assert (away < 10).sum() < 0.4 * (before < 10).sum()
    assert (away > 45).sum() == pytest.approx((before > 45).sum(), abs=2)


def test_a_jammer_stays_where_it_is():
    places = {jammer.draw("noise_jam", 50, DrawKey(1, "r", k)).azimuth_deg for k in range(20)}
    assert len(places) == 1
    assert places != {jammer.draw("noise_jam", 50, DrawKey(2, "r", 0)).azimuth_deg}


def test_interference_hits_half_of_the_scans_and_sets_the_radars_bit():
    drawn = [jammer.draw("interference", 100, DrawKey(1, "radar", k)) for k in range(2000)]
    hit = [one for one in drawn if one.ghosts]
    assert len(hit) / 2000 == pytest.approx(0.5, abs=4 * math.sqrt(0.25 / 2000))
    assert {one.ghosts for one in hit} == set(range(1, 21))
    state = RadarState("radar", 0, 0, {"RadarState_Interference": 0.0, "RadarState_SensorID": 0.0})
    for one in drawn[:20]:
        marked = jammer.marked(one, state)
        assert marked.values["RadarState_Interference"] == float(one.ghosts > 0)
    assert state.values["RadarState_Interference"] == 0.0


def test_a_burst_lies_on_one_line_of_sight():
    scan = make_scan([20.0, 150.0], [0.1, 0.1], rcs=30.0)
    drawn = next(
        one
        for k in range(100)
        if (one := jammer.draw("interference", 100, DrawKey(1, "r", k))).ghosts > 15
    )
    result = jammer.apply(drawn, scan)
    ghosts = (np.hypot(result.x, result.y) > 5) & (np.abs(result.rcs) <= 30)
    azimuth = np.degrees(np.arctan2(result.y, result.x))[ghosts]
    assert abs(np.median(azimuth) - drawn.azimuth_deg) < 3
    assert len(result) == 2 + drawn.ghosts


def test_deception_pulls_one_target_away_and_lets_go():
    scan = make_scan([30.0, 30.6, 80.0], [0.1, 0.5, 0.1], vx=-5.0, rcs=[20.0, 5.0, 10.0])
    for k, progress in ((0, 0.0), (50, 0.5), (99, 0.99), (100, 0.0)):
        result = degrade(jammer, "deception", 100, scan, DrawKey(1, "radar", k))
        moved = np.sort(result.x[result.rcs != 10.0])
        assert moved == pytest.approx([30 + 60 * progress, 30.6 + 60 * progress], abs=0.4)
        fast = result.vx[result.rcs == 20.0]
        assert fast == pytest.approx(-5 + 30 * progress, abs=0.25)
        assert result.x[result.rcs == 10.0] == pytest.approx(80.0, abs=0.01)


# Propagation


def road():
    """Return a guard rail at y = 5.1 m, and a car at (30, 1.1) that comes nearer at 8 m/s."""
    rail = np.arange(8.0, 60.0, 4.0)
    x, y = np.append(rail, 30.0), np.append(np.full(len(rail), 5.1), 1.1)
    moving = np.append(np.ones(len(rail), np.uint8), np.uint8(0))
    scan = make_scan(
        x, y, vx=np.append(np.full(len(rail), -15.0), -8.0), rcs=np.append(rail * 0, 25)
    )
    return replace(scan, dyn_prop=moving)


def test_the_rail_is_where_standing_clusters_line_up():
    assert propagation.rail_offset(Clusters(road(), ARS408)) == pytest.approx(5.1, abs=0.01)
    assert propagation.rail_offset(Clusters(make_scan([10.0], 5.0), ARS408)) is None


def test_images_lie_where_the_mirror_puts_them():
    result = degrade(propagation, "multipath", 100, road())
    found = {
        (round(float(x), 1), round(float(y), 1)) for x, y in zip(result.x, result.y, strict=True)
    }
    image_y = 2 * 5.1 - 1.1
    assert any(abs(x - 30) < 0.21 and abs(y - image_y) < 0.21 for x, y in found)
    assert any(abs(x - 60) < 0.21 and abs(y - 2.2) < 0.21 for x, y in found)
    assert len(result) == len(road()) + 2
    assert set(result.dyn_prop[(result.x > 59.9) | (result.y > 8)]) == {0}


@given(
    st.floats(1, 100), st.floats(-4, 4), st.floats(-30, 30), st.floats(-10, 10), st.floats(5, 12)
)
def test_an_image_is_a_mirror_image(x, y, vx, vy, offset):
    row = np.array([[x], [y], [vx], [vy], [10.0]])
    image = propagation.mirrored(row, offset)[:, 0]
    assert (image[1] + y) / 2 == pytest.approx(offset)
    at_wall = np.array([x, offset])
    assert np.hypot(*(image[:2] - at_wall)) == pytest.approx(
        np.hypot(*(np.array([x, y]) - at_wall))
    )
    across = image[0] * image[3] - image[1] * image[2]
    assert across == pytest.approx(0, abs=1e-6)
    radial = (image[0] * image[2] + image[1] * image[3]) / np.hypot(*image[:2])
    step = 1e-6  # the image's range really changes at that rate
    later = np.hypot(x + vx * step, 2 * offset - (y + vy * step))
    assert radial == pytest.approx((later - np.hypot(image[0], image[1])) / step, abs=1e-3)


def test_blockage_weakens_what_it_does_not_hide():
    loud = replace(fan(), rcs=np.full(241, 25.0, np.float32))
    losses = [25 - degrade(propagation, "blockage", level, loud).rcs for level in (10, 20)]
    for level, loss in zip((10, 20), losses, strict=True):
        mean = 20 * level / 100
        assert mean / 2 - 0.25 <= loss.min() < mean < loss.max() <= 2 * mean + 0.25
    assert len(degrade(propagation, "blockage", 100, fan())) == 0


def test_misalignment_turns_the_world():
    result = degrade(propagation, "misalignment", 100, make_scan([50.0], 0.1, vx=-10.0))
    assert np.abs(np.degrees(np.arctan2(result.y, result.x))) == pytest.approx([5.0], abs=0.4)
    assert np.hypot(result.x, result.y) == pytest.approx([50.0], abs=0.2)
    assert np.sign(result.vy) == -np.sign(result.y)
