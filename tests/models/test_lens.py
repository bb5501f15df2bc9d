"""What sticks to the lens: maps, their averages in time, and what they change in an estimate."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from dbc.errors import ModelError
from models.degrade.draw import DrawKey
from models.estimate.camera import CameraEstimator, CameraHistory
from models.estimate.lens import (
    BANDS,
    CHANNELS,
    LOG_RATIOS,
    LONGEST_GAP_S,
    LOOK_EVERY_S,
    TIME_CONSTANT_S,
    LensHistory,
    LensNetwork,
    lens_cells,
    lens_input,
)
from models.estimate.level import CAMERA_KINDS, FRAME_KINDS, LENS_KINDS, LEVELS, Estimate
from models.estimate.network import WEIGHTS
from models.evaluate.camera import degrade
from models.evaluate.camera_clip import CLIPS, clip_frames
from models.world.camera import WorldCamera
from models.world.road import World

S = 10**9
Image = NDArray[np.uint8]


def textured(seed: int, height: int = 90, width: int = 160) -> Image:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


@pytest.fixture(scope="module")
def drive() -> list[Image]:
    """Return clean frames of a simulated drive."""
    camera = WorldCamera(World(5, 4.0), width=320, height=180, rate_hz=15.0)
    return [frame.image for frame in camera.frames()]


@given(st.integers(1, 400), st.integers(1, 400), st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=30)
def test_any_image_has_a_finite_map(height: int, width: int, seed: int) -> None:
    cells = lens_cells(textured(seed, height, width))
    assert cells.shape[:2] == (2, BANDS)
    assert cells.dtype == np.float32
    assert np.all(np.isfinite(cells))


def test_a_map_is_that_of_the_scene_at_any_size() -> None:
    """Brightness of the places, and less detail where half the frame is smooth."""
    rng = np.random.default_rng(3)
    for height, width in ((360, 640), (900, 1600)):
        image = np.full((height, width, 3), 80, np.uint8)
        image[:, width // 2 :] = 160
        image[:, : width // 2] += rng.integers(0, 20, (height, width // 2, 1), np.uint8)
        detail, brightness = lens_cells(image)
        columns = detail.shape[1]
        assert columns == round(64 * width / height)
        left, right = np.s_[:, : columns // 2 - 1], np.s_[:, columns // 2 + 1 :]
        assert brightness[right] == pytest.approx(np.log2(162.0), abs=1e-4)
        assert brightness[left].mean() == pytest.approx(np.log2(91.5), abs=0.02)
        assert detail[left].min() > detail[right].max() + 3


@given(st.lists(st.integers(0, 99), min_size=1, max_size=6), st.floats(0.25, 1.0))
@settings(deadline=None, max_examples=25)
def test_averages_are_those_of_weights_that_fade(seeds: list[int], spacing_s: float) -> None:
    spacing_ns = int(np.ceil(spacing_s * S))
    images = [textured(seed) for seed in seeds]
    history = LensHistory.begin(5 * S, images[0])
    for look, image in enumerate(images[1:], start=1):
        history = history.after(5 * S + look * spacing_ns, image)
    seen = np.array([lens_cells(image) for image in images], np.float64)
    weights = np.exp(-np.arange(len(seen))[::-1] * spacing_ns * 1e-9 / TIME_CONSTANT_S)
    expected = np.average(seen, axis=0, weights=weights)
    spread = np.sqrt(np.average((seen - expected) ** 2, axis=0, weights=weights))
    given_in = lens_input(history)
    assert given_in.shape == (CHANNELS, BANDS, seen.shape[3])
    np.testing.assert_allclose(given_in[:2], expected, atol=1e-4)
    np.testing.assert_allclose(given_in[2:4], spread, atol=0.03)
    assert history.age_s == pytest.approx((len(seen) - 1) * spacing_ns * 1e-9)


def test_a_frame_too_soon_or_late_changes_nothing() -> None:
    history = LensHistory.begin(0, textured(0)).after(S, textured(1))
    for stamp_ns in (S + S // 5, S, S - 1, S // 2):
        assert history.after(stamp_ns, textured(2)) is history


@pytest.mark.parametrize("stamp_ns", [S + int(1.01 * LONGEST_GAP_S * S), -3600 * S, 86_400 * S])
def test_after_a_gap_or_with_a_clock_set_back_it_begins_anew(stamp_ns: int) -> None:
    history = LensHistory.begin(0, textured(0)).after(S, textured(1)).after(stamp_ns, textured(2))
    assert history.began_ns == history.stamp_ns == stamp_ns


def test_another_size_begins_anew_even_of_the_same_proportions() -> None:
    history = LensHistory.begin(0, textured(0)).after(S, textured(1))
    other = history.after(S + 40_000_000, textured(2, 180, 320))
    assert (other.age_s, other.size) == (0, (180, 320))


def frame_says(clean: float, lens: NDArray[np.float64]) -> Estimate:
    """Return what a frame says that is clean, or else of blur 60 %."""
    kinds = dict.fromkeys(CAMERA_KINDS, 0.0) | {"clean": clean, "blur": 1 - clean}
    probabilities = np.where(LEVELS == 0, clean, np.where(LEVELS == 60, 1 - clean, 0.0))
    return Estimate(probabilities, kinds, lens=lens)


@given(st.floats(0, 1), arrays(np.float64, LOG_RATIOS, elements=st.floats(-1e6, 1e6)))
def test_it_stays_a_distribution_whatever_the_lens_says(
    clean: float, lens: NDArray[np.float64]
) -> None:
    before = frame_says(clean, lens)
    after = before.with_lens()
    assert np.all(after.probabilities >= 0)
    assert after.probabilities.sum() == pytest.approx(1, abs=1e-12)
    assert sum(after.kind_probabilities.values()) == pytest.approx(1, abs=1e-12)
    for kind in set(FRAME_KINDS) - {"clean", "dirt"}:
        assert after.kind_probabilities[kind] == before.kind_probabilities[kind]
    assert after.level >= before.level - 1e-9
    assert after.with_lens() is after


def test_what_the_lens_is_sure_of_takes_the_clean_share_and_nothing_else() -> None:
    lens = np.full(LOG_RATIOS, -50.0)
    assert frame_says(1.0, lens).with_lens().level == pytest.approx(0, abs=1e-9)
    lens[LENS_KINDS.index("drops"), 3] = 25.0
    sure = frame_says(1.0, lens).with_lens()
    assert (sure.kind, sure.level) == ("drops", pytest.approx(40, abs=1e-4))
    blurred = frame_says(0.0, lens).with_lens()
    assert (blurred.kind, blurred.level) == ("blur", pytest.approx(60))


@pytest.mark.parametrize("shape", [(1, 1), (90, 1), (1, 3000), (90, 160), (300, 100), (64, 900)])
def test_the_network_takes_any_size_and_extremes(shape: tuple[int, int]) -> None:
    network, estimator = LensNetwork(), CameraEstimator()
    black, white = (np.full((*shape, 3), value, np.uint8) for value in (0, 255))
    history: CameraHistory | None = None
    for look, image in enumerate([black, textured(1, *shape), white, black]):
        estimate, history = estimator.estimate_next(history, image, look * S)
        log_ratios = network.log_ratios(history.lens)
        assert log_ratios.shape == LOG_RATIOS
        assert np.all(np.isfinite(log_ratios))
        assert estimate.with_lens().probabilities.sum() == pytest.approx(1, abs=1e-12)


def test_a_run_of_a_day_says_what_one_of_a_minute_says() -> None:
    network = LensNetwork()
    history = LensHistory.begin(0, textured(0))
    for look in range(1, 8):
        history = history.after(look * S, textured(look))
    minute, day = (
        LensHistory(-age_s * S, history.stamp_ns, history.size, history.averages)
        for age_s in (60, 86_400)
    )
    np.testing.assert_array_equal(network.log_ratios(minute), network.log_ratios(day))


@pytest.mark.parametrize("name", ["camera.onnx", "missing.onnx", "camera.md"])
def test_another_file_is_refused(name: str) -> None:
    with pytest.raises(ModelError, match=name.split(".", maxsplit=1)[0]):
        LensNetwork(WEIGHTS / name)


@pytest.mark.parametrize("value", [0, 128, 255])
def test_where_nothing_shows_it_stays_unsure(value: int) -> None:
    estimator, history = CameraEstimator(), None
    image = np.full((360, 640, 3), value, np.uint8)
    alone = estimator.estimate(image)
    for look in range(20):
        estimate, history = estimator.estimate_next(history, image, look * S // 2)
    assert abs(estimate.with_lens().level - alone.level) < 15
    assert estimate.with_lens().std > 10


def test_a_lens_is_looked_at_no_more_often_than_it_takes(drive: list[Image]) -> None:
    estimator, history = CameraEstimator(), None
    stamps, said = set(), []
    for number, image in enumerate(drive):
        estimate, history = estimator.estimate_next(history, image, number * 40_000_000)
        stamps.add(history.lens.stamp_ns)
        said.append(estimate.lens)
    looks = sorted(stamps)
    assert len(looks) > 5
    assert all(later - earlier >= LOOK_EVERY_S * S for earlier, later in pairwise(looks))
    assert said[0] is None
    assert said[-1] is not None


def test_a_late_frame_is_told_what_is_known_of_the_lens_and_leaves_no_trace(
    drive: list[Image],
) -> None:
    estimator, history = CameraEstimator(), None
    for number in range(4):
        newest, history = estimator.estimate_next(history, drive[number], number * S // 2)
    late, after = estimator.estimate_next(history, drive[9], S)
    assert after is history
    assert late.lens is newest.lens is not None


def test_degraded_frames_leave_no_trace_in_what_is_seen_of_the_lens(drive: list[Image]) -> None:
    estimator, history = CameraEstimator(), None
    for number in range(4):
        _, history = estimator.estimate_next(history, drive[number], number * S // 2)
    assert history is not None
    noisy = degrade("noise", 80.0, DrawKey(0, "c", 0), drive[4])[1]
    estimate, after = estimator.estimate_next(history, noisy, 2 * S)
    assert estimate.kind == "noise"
    assert after.lens is history.lens
    _, later = estimator.estimate_next(after, drive[5], 4 * S)
    assert later.lens.age_s == 0


def test_threads_that_share_an_estimator_change_nothing(drive: list[Image]) -> None:
    estimator = CameraEstimator()

    def run(_: int) -> NDArray[np.float64]:
        history = None
        for number in range(6):
            estimate, history = estimator.estimate_next(history, drive[number], number * S // 2)
        assert estimate.lens is not None
        return estimate.lens

    alone = run(0)
    with ThreadPoolExecutor(4) as pool:
        assert all(np.array_equal(alone, other) for other in pool.map(run, range(8)))


@pytest.mark.parametrize("clip", CLIPS)
def test_a_clean_clip_stays_clean(data: Path, clip: str) -> None:
    look = CameraEstimator().follow()
    said = [
        look(frame.image, frame.stamp_ns).with_lens() for frame in clip_frames(data, clip, every=3)
    ]
    assert np.mean([estimate.level for estimate in said]) < 3
    assert np.mean([estimate.kind == "clean" for estimate in said]) > 0.95


@pytest.mark.parametrize("clip", CLIPS[:2])
@pytest.mark.parametrize(("kind", "level"), [("drops", 100.0), ("dirt", 60.0)])
def test_what_sticks_to_the_lens_by_day_is_told_after_some_seconds(
    data: Path, clip: str, kind: str, level: float
) -> None:
    look, said = CameraEstimator().follow(), []
    for frame in clip_frames(data, clip, every=3):
        image = degrade(kind, level, DrawKey(0, "camera", frame.sequence), frame.image)[1]
        said.append(look(image, frame.stamp_ns).with_lens())
    late = said[len(said) // 2 :]
    assert np.mean([estimate.kind == kind for estimate in late]) > 0.6
    assert np.mean([estimate.level for estimate in late]) > 25
