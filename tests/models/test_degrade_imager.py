from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc.errors import InputError
from models.degrade import imager
from models.degrade.draw import DrawKey
from models.degrade.pointwise import looked_up

KEY = DrawKey(1, "camera", 3)


def degrade(kind, level, image, key=KEY):
    return imager.apply(imager.draw(kind, level, key), image)


def scene(height=120, width=160):
    random = np.random.default_rng(0)
    coarse = random.uniform(20, 235, (height // 8 + 1, width // 8 + 1, 3)).astype(np.float32)
    return cv2.resize(coarse, (width, height)).astype(np.uint8)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 300), st.integers(1, 3), st.integers(0, 2**32))
def test_a_table_of_bytes_is_looked_up_value_by_value(length, step, seed):
    random = np.random.default_rng(seed)
    table = random.integers(0, 256, 256, dtype=np.uint8)
    values = random.integers(0, 256, (3, length * step), dtype=np.uint8)[:, ::step]
    before = values.copy()
    np.testing.assert_array_equal(looked_up(values, table), table[values])
    np.testing.assert_array_equal(values, before)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.1, 100), st.integers(1, 60), st.integers(1, 60), st.integers(0, 2**32))
def test_jpeg_is_opencvs_to_the_bit(level, height, width, seed):
    image = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    drawn = imager.draw("jpeg", level, KEY)
    _, stream = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, drawn.quality])
    np.testing.assert_array_equal(imager.apply(drawn, image), cv2.imdecode(stream, 1))


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(imager.KINDS), st.floats(0, 100), st.integers(1, 30), st.integers(1, 30))
def test_any_level_and_size(kind, level, height, width):
    image = scene(height, width)
    result = degrade(kind, level, image)
    assert (result.dtype, result.shape) == (np.uint8, image.shape)


def test_bad_requests_are_refused():
    with pytest.raises(InputError, match="0 to 100"):
        imager.draw("motion", float("nan"), KEY)
    with pytest.raises(InputError, match="no such degradation"):
        imager.draw("blur", 10, KEY)
    with pytest.raises(InputError, match="uint8"):
        degrade("jpeg", 10, scene().astype(np.uint16))


@pytest.mark.parametrize("direction", [0.0, 45.0, 90.0, 135.0])
def test_a_smeared_point_has_the_length_and_direction_of_the_smear(direction):
    image = np.zeros((101, 101, 3), np.uint8)
    image[50, 50] = 255
    trail = imager.apply(imager.Motion("motion", 50, 20.0, direction), image)[..., 0]
    y, x = np.nonzero(trail)
    length = max(np.ptp(x), np.ptp(y)) / max(
        abs(np.cos(np.radians(direction))), abs(np.sin(np.radians(direction)))
    )
    assert length == pytest.approx(20, abs=3)
    assert abs(x.mean() - 50) <= 1
    assert abs(y.mean() - 50) <= 1
    if direction == 0:
        assert np.ptp(y) == 0
    if direction in (45, 135):
        slope = np.polyfit(x, y, 1)[0]  # rows count downwards
        assert slope == pytest.approx(1 if direction == 45 else -1, abs=0.1)


def test_smear_keeps_constants():
    image = np.full((30, 40, 3), 77, np.uint8)
    np.testing.assert_array_equal(degrade("motion", 100, image), image)


def test_the_tunnel_dazzles_then_darkens_and_recovers():
    image = np.full((8, 8, 3), 20, np.uint8)
    means = [degrade("tunnel", 100, image, DrawKey(1, "c", k)).mean() for k in range(200)]
    assert means[0] == 255
    assert means[100] == round(20 / 16)
    assert (np.diff(means[:100]) <= 0).all()
    assert (np.diff(means[100:]) >= 0).all()
    assert means[99] == means[199] == 20


@pytest.mark.parametrize("value", [60, 120, 180])
def test_poisson_variance_grows_with_the_signal(value):
    image = np.full((300, 300, 3), value, np.uint8)
    noise = degrade("poisson", 10, image).astype(float) - value
    expected = 2.0 * value + 1.0**2 + 1 / 12
    assert noise.var() == pytest.approx(expected, rel=0.03)
    assert abs(noise.mean()) < 4 * np.sqrt(expected / noise.size) + 0.02


def test_low_light_has_the_noise_of_its_electrons():
    """6 stops down from 8,000 electrons leave 125 at white; the gain shows them as 32 counts."""
    image = np.full((300, 300, 3), 255, np.uint8)
    dark = degrade("low_light", 100, image).astype(float)
    assert dark.mean() == pytest.approx(255 / 8, abs=0.2)
    shot_and_read = (255 / 8 / 125) ** 2 * (125 + 9)
    well_lit = (255 / 8 / 8000) ** 2 * (8000 + 9)
    assert dark.var() == pytest.approx(shot_and_read - well_lit + 1 / 12, rel=0.03)


@pytest.mark.parametrize("level", [0.5, 10, 100])
def test_the_share_of_stuck_pixels_is_the_levels(level):
    image = np.full((400, 400, 3), 128, np.uint8)
    result = degrade("salt_pepper", level, image)
    share = level / 100 * 0.2
    for value in (0, 255):
        found = (result == value).all(axis=2).mean()
        assert found == pytest.approx(share / 2, abs=4 * np.sqrt(share / 2 / 160_000) + 1e-5)
    assert set(np.unique(result)) <= {0, 128, 255}


def test_dead_pixels_stay_and_add_up():
    image = np.full((200, 300, 3), 128, np.uint8)
    frames = [degrade("dead", 50, image, DrawKey(1, "camera", k)) for k in (0, 9)]
    np.testing.assert_array_equal(*frames)
    worse = degrade("dead", 100, image)
    assert (worse != 128)[frames[0] != 128].all()
    assert (frames[0] != 128).all(axis=(1, 2)).sum() == 1
    other = degrade("dead", 50, image, DrawKey(1, "another", 0))
    assert (other != frames[0]).any()
