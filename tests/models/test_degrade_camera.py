from __future__ import annotations

from statistics import NormalDist

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc.errors import InputError
from models.degrade import camera
from models.degrade.draw import DrawKey

KEY = DrawKey(1, "camera", 5)
LEVELS = range(0, 101, 10)


def degrade(kind, level, image, key=KEY, **options):
    return camera.apply(camera.draw(kind, level, key, **options), image)


def scene(height=120, width=161, seed=0):
    """Return an image with power at every scale, as photographs have."""
    random = np.random.default_rng(seed)
    image = np.zeros((height, width, 3), np.float32)
    for octave in (2, 4, 8, 16, 32):
        coarse = random.normal(0, 9 * octave**0.5, (height // octave + 2, width // octave + 2, 3))
        image += cv2.resize(coarse.astype(np.float32), (width, height))
    return np.clip(image + 110, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("kind", camera.KINDS)
@pytest.mark.parametrize("method", ["fast", "exact"])
def test_level_0_is_the_identity_and_no_level_changes_the_input(kind, method):
    image = scene()
    before = image.copy()
    assert degrade(kind, 0, image, method=method).tobytes() == before.tobytes()
    for level in (1e-9, 37, 100):
        result = degrade(kind, level, image, method=method)
        assert (result.dtype, result.shape) == (np.uint8, image.shape)
        assert not np.shares_memory(result, image)
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("kind", camera.KINDS)
def test_the_result_depends_on_nothing_but_parameters_and_input(kind):
    image = scene(300, 400)
    degradation = camera.draw(kind, 60, KEY)
    threads = cv2.getNumThreads()
    try:
        results = []
        for count in (1, 8):
            cv2.setNumThreads(count)
            results += [camera.apply(degradation, image) for _ in range(2)]
    finally:
        cv2.setNumThreads(threads)
    assert len({result.tobytes() for result in results}) == 1
    assert camera.draw(kind, 60, KEY) == degradation
    view = np.pad(image, ((5, 5), (5, 5), (0, 0)))[5:-5, 5:-5]
    np.testing.assert_array_equal(camera.apply(degradation, view), results[0])


@pytest.mark.parametrize("level", [float("nan"), float("inf"), -1e-9, -1, 100.1, 1000, 1e6])
def test_impossible_levels_are_refused(level):
    with pytest.raises(InputError, match="0 to 100"):
        camera.draw("blur", level, KEY)


def test_unknown_kinds_and_methods_are_refused():
    with pytest.raises(InputError, match="no such degradation"):
        camera.draw("fog", 10, KEY)
    with pytest.raises(InputError, match="unknown"):
        camera.draw("blur", 10, KEY, method="quick")
    with pytest.raises(InputError, match="no published variant"):
        camera.draw("over", 10, KEY, method="published")
    with pytest.raises(InputError, match="out of range"):
        camera.draw("noise", 10, KEY, std_max=float("nan"))


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((4, 5), np.uint8),
        np.zeros((4, 5, 4), np.uint8),
        np.zeros((4, 5, 3), np.uint16),
        np.zeros((4, 5, 3), np.float32),
        np.zeros((0, 5, 3), np.uint8),
    ],
)
def test_other_images_are_refused(image):
    for level in (0, 50):
        with pytest.raises(InputError, match=r"\(height, width, 3\) uint8"):
            degrade("noise", level, image)


@pytest.mark.parametrize("kind", camera.KINDS)
@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (2, 3), (21, 22), (23, 23)])
@pytest.mark.parametrize("value", [0, 255])
def test_small_and_constant_images(kind, size, value):
    image = np.full((*size, 3), value, np.uint8)
    for level in (1e-9, 45, 100):
        result = degrade(kind, level, image)
        assert result.shape == image.shape
        if kind == "blur":
            np.testing.assert_array_equal(result, image)


@pytest.mark.parametrize("method", ["fast", "exact"])
@pytest.mark.parametrize("level", LEVELS)
def test_exposure_of_a_constant_is_its_gain(level, method):
    N = level / 100
    for value in range(256):
        image = np.full((5, 6, 3), value, np.uint8)
        for kind, light in (("over", value * (1 + 3 * N)), ("under", value / (1 + 3 * N))):
            result = degrade(kind, level, image, method=method)
            tie = abs(light % 1 - 0.5) <= value / 2048  # gains are multiples of 1/1024
            expected = {min(255, round(light))}
            if tie:
                expected |= {min(255, int(light)), min(255, int(light) + 1)}
            assert len(np.unique(result)) == 1
            assert int(result.flat[0]) in expected


@pytest.mark.parametrize("kind", ["over", "under", "blur"])
@pytest.mark.parametrize("level", [5, 30, 60, 100])
def test_the_fast_method_stays_close_to_the_exact_one(kind, level):
    image = scene(200, 300)
    error = np.abs(
        degrade(kind, level, image).astype(int) - degrade(kind, level, image, method="exact")
    )
    assert error[10:-10, 10:-10].max() <= (4 if kind == "blur" else 1)


@pytest.mark.parametrize("level", [10, 50, 100])
def test_exact_blur_is_the_gaussian_of_the_paper(level):
    N = level / 100
    size, sigma = max(3, 2 * round(10 * N) + 1), 3 * N + 0.5
    image = np.zeros((61, 61, 3), np.uint8)
    image[30, 30] = 255
    offsets = np.arange(61) - 30.0
    kernel = np.where(np.abs(offsets) <= size // 2, np.exp(-(offsets**2) / (2 * sigma**2)), 0)
    kernel /= kernel.sum()
    blurred = degrade("blur", level, image, method="exact")[..., 0]
    assert np.abs(blurred - 255 * np.outer(kernel, kernel)).max() <= 1


@pytest.mark.parametrize("method", ["fast", "exact"])
@pytest.mark.parametrize("level", [5, 50, 100])
def test_blur_keeps_the_mean(level, method):
    image = np.pad(scene(), ((40, 40), (40, 40), (0, 0)))  # nothing near the border leaves it
    blurred = degrade("blur", level, image, method=method)
    assert blurred.mean() == pytest.approx(image.mean(), abs=0.3)


def test_blur_is_continuous_and_the_published_variant_is_another():
    assert camera.draw("blur", 10, KEY).sigma == pytest.approx(0.8)
    assert camera.draw("blur", 10 - 1e-9, KEY).sigma == pytest.approx(0.8)
    published = camera.draw("blur", 50, KEY, method="published")
    assert (published.size, published.sigma) == (11, 10.0)


@pytest.mark.parametrize("kind", ["blur", "over", "under"])
def test_each_level_is_worse_than_the_one_before(kind):
    image = scene()
    measures = []
    for level in LEVELS:
        result = degrade(kind, level, image)
        measures.append(
            -cv2.Laplacian(result, cv2.CV_64F).var() if kind == "blur" else result.mean()
        )
    steps = np.diff(measures) * (-1 if kind == "under" else 1)
    assert (steps > 0).all()


@pytest.mark.parametrize("method", ["fast", "exact"])
@pytest.mark.parametrize("level", [0.1, 1, 7, 30])
def test_the_noise_is_a_rounded_gaussian(level, method):
    """Kolmogorov–Smirnov over 600,000 draws: 0.0025 is the bound at 1 in 1,000."""
    image = np.full((400, 500, 3), 128, np.uint8)
    noise = degrade("noise", level, image, method=method).astype(int) - 128
    for channel in range(3):
        assert noise[..., channel].std() == pytest.approx(np.hypot(level, 12**-0.5), rel=0.02) or (
            level < 1
        )
    values, counts = np.unique(noise[np.abs(noise) < 127], return_counts=True)
    measured = np.cumsum(counts) / noise.size
    expected = np.array([NormalDist(0, level).cdf(value + 0.5) for value in values])
    assert np.abs(measured - expected).max() < 0.0025


def test_noise_saturates_and_never_wraps():
    dark, bright = (np.full((100, 100, 3), value, np.uint8) for value in (3, 252))
    assert abs(np.median(degrade("noise", 100, dark)) - 3) < 3
    assert (degrade("noise", 100, dark) == 0).mean() == pytest.approx(0.49, abs=0.02)
    assert (degrade("noise", 100, bright) == 255).mean() == pytest.approx(0.49, abs=0.02)


def test_published_noise_behaves_as_salt():
    image = np.full((200, 200, 3), 100, np.uint8)
    noisy = degrade("noise", 100, image, method="published")
    assert (noisy == 255).mean() == pytest.approx(NormalDist().cdf(-1), abs=0.01)
    assert not (noisy < 100).any()


def test_noise_repeats_neither_in_a_frame_nor_between_frames():
    image = np.full((300, 400, 3), 128, np.uint8)
    frames = [
        degrade("noise", 20, image, DrawKey(1, "camera", sequence)).ravel() - 128.0
        for sequence in (0, 1)
    ]
    spectra = [np.fft.rfft(frame / frame.std(), 2 * frame.size) for frame in frames]
    within = np.fft.irfft(np.abs(spectra[0]) ** 2) / frames[0].size
    between = np.fft.irfft(spectra[0] * spectra[1].conj()) / frames[0].size
    assert np.abs(within[1 : frames[0].size]).max() < 0.01
    assert np.abs(between).max() < 0.01


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(camera.KINDS), st.floats(0, 100), st.integers(1, 40), st.integers(1, 40))
def test_any_level_and_size(kind, level, height, width):
    image = scene(height, width)
    result = degrade(kind, level, image)
    assert (result.dtype, result.shape) == (np.uint8, image.shape)
