from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc.errors import InputError
from models.degrade import haze, weather
from models.degrade.draw import DrawKey

KEY = DrawKey(1, "camera", 3)


def degrade(kind, level, image, key=KEY, **options):
    return weather.apply(weather.draw(kind, level, key), image, **options)


def scene(height=180, width=320):
    random = np.random.default_rng(0)
    coarse = random.uniform(0, 140, (height // 8 + 1, width // 8 + 1, 3)).astype(np.float32)
    return cv2.resize(coarse, (width, height)).astype(np.uint8)


@settings(max_examples=50, deadline=None)
@given(st.sampled_from(weather.KINDS), st.floats(0, 100), st.integers(1, 40), st.integers(1, 40))
def test_any_level_and_size(kind, level, height, width):
    image = scene(height, width)
    result = degrade(kind, level, image)
    assert (result.dtype, result.shape) == (np.uint8, image.shape)


def test_bad_requests_are_refused():
    with pytest.raises(InputError, match="0 to 100"):
        weather.draw("fog", -1, KEY)
    with pytest.raises(InputError, match="no such degradation"):
        weather.draw("hail", 10, KEY)
    with pytest.raises(InputError, match="uint8"):
        degrade("fog", 10, scene().astype(np.float32))
    with pytest.raises(InputError, match="depth map"):
        degrade("fog", 10, scene(), depth_m=np.ones((3, 3), np.float32))


@pytest.mark.parametrize("distance", [0.5, 10.0, 50.0, 200.0, 1e6, math.inf, math.nan, -1.0])
def test_fog_of_a_given_depth_is_koschmieders_law(distance):
    image = np.full((40, 60, 3), 40, np.uint8)
    image[:18] = 200  # the sky lights the air
    fifty = haze.Haze(extinction=haze.CONTRAST_LIMIT / 50, airlight=0.9)
    fog = weather.Weather("fog", 100, fifty, 0, 0.0, ())
    depth = np.full((40, 60), distance, np.float32)
    result = weather.apply(fog, image, depth_m=depth)[18:].astype(float)
    usable = distance if distance > 0 else math.inf
    t = math.exp(-min(usable, haze.FARTHEST_M) * fifty.extinction)
    assert np.abs(result - (40 * t + 0.9 * 200 * (1 - t))).max() <= 1
    if distance == 50:  # at the visibility range 2 % of the contrast is left
        assert t == pytest.approx(0.02, rel=1e-3)


@pytest.mark.parametrize("horizon", [0.2, 0.45, 0.7])
def test_fog_thickens_toward_the_horizon(horizon):
    image = np.zeros((180, 320, 3), np.uint8)
    image[:, ::2] = 200  # of one light all over, and with contrast
    drawn = weather.draw("fog", 30, KEY, horizon=horizon)
    even = replace(drawn, haze=replace(drawn.haze, patchiness=0.0))
    contrast = weather.apply(even, image).std(axis=(1, 2))
    assert contrast[round(horizon * 180)] < contrast.min() + 3
    assert contrast.min() < contrast[0]
    assert contrast.min() < 0.3 * contrast[-1]


@pytest.mark.parametrize("horizon", [-0.1, 1.1, math.nan])
def test_an_impossible_horizon_is_refused(horizon):
    with pytest.raises(InputError, match="horizon"):
        weather.draw("fog", 50, KEY, horizon=horizon)


@pytest.mark.parametrize("kind", ["fog", "rain", "snow", "dirt"])
def test_the_air_is_as_bright_as_the_scene(kind):
    """At night nothing glows, nor do flakes and streaks but by the light that there is."""
    day = np.maximum(scene(), 100)
    night = day // 10
    brightest = [int(degrade(kind, 100, image).max()) for image in (day, night)]
    assert brightest[1] < 2 * night.max()
    assert brightest[0] > 5 * brightest[1]


def test_a_lamp_does_not_light_the_whole_night():
    night = np.full((180, 320, 3), 10, np.uint8)
    assert haze.scene_light(night) == 10
    night[30:50, 100:120] = 255
    assert haze.scene_light(night) == 10


def test_fog_drifts_without_jumps_and_drops_stay():
    image = scene()

    def at(kind, sequence):
        return degrade(kind, 50, image, DrawKey(1, "camera", sequence)).astype(int)

    fog = [np.abs(at("fog", 500 + k) - at("fog", 500)).mean() for k in (1, 50)]
    assert 0 < fog[0] < 0.5 < fog[1]
    np.testing.assert_array_equal(at("drops", 1), at("drops", 2))
    np.testing.assert_array_equal(at("dirt", 1), at("dirt", 2000))
    lives = [tuple(weather.draw("drops", 50, DrawKey(1, "c", k)).seeds) for k in range(200)]
    changed = [sum(map(int.__ne__, *pair)) for pair in pairwise(lives)]
    assert set(changed) == {0, 1}


def test_rain_falls_anew_in_every_image():
    image = scene()
    first, second = (degrade("rain", 100, image, DrawKey(1, "c", k)) for k in (1, 2))
    assert (first != second).any()


@pytest.mark.parametrize("level", [10, 50, 100])
def test_dirt_covers_the_share_that_the_level_says(level):
    image = np.full((180, 320, 3), 250, np.uint8)
    covered = (degrade("dirt", level, image) < 249).mean()
    assert covered == pytest.approx(0.6 * level / 100, abs=0.05)


def test_a_drop_shows_the_scene_upside_down():
    image = np.zeros((400, 640, 3), np.uint8)
    image[:200] = 200
    drawn = weather.draw("drops", 100, KEY)
    result = weather.apply(drawn, image).astype(int) - image
    assert result[:200].min() < -100  # dark road in drops on the sky
    assert result[200:].max() > 100  # bright sky in drops on the road
