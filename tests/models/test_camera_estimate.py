from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from dbc.errors import InputError
from drivers.video import open_video
from models.degrade.camera import KINDS, apply, draw
from models.degrade.draw import DrawKey
from models.estimate.camera import CameraEstimator
from models.estimate.level import CAMERA_KINDS, Estimate
from models.evaluate.camera import clean_frames, degrade, measure
from models.evaluate.camera_tables import extremes

CLIPS = ("day_highway_960x540_25fps", "day_city_1242x374_10fps", "night_1920x1080_30fps")


@pytest.fixture(scope="module")
def estimator() -> CameraEstimator:
    return CameraEstimator()


def assert_sound(estimate: Estimate) -> None:
    assert estimate.probabilities.shape == (11,)
    assert np.all(estimate.probabilities >= 0)
    assert estimate.probabilities.sum() == pytest.approx(1, abs=1e-12)
    assert 0 <= estimate.level <= 100
    assert 0 <= estimate.std <= 50
    assert tuple(estimate.kind_probabilities) == CAMERA_KINDS
    assert sum(estimate.kind_probabilities.values()) == pytest.approx(1, abs=1e-12)


EXTREMES = extremes() | {
    "one column": np.arange(3000, dtype=np.uint8).reshape(1000, 1, 3),
}


@pytest.mark.parametrize("name", EXTREMES)
def test_any_image_has_a_sound_estimate(estimator: CameraEstimator, name: str) -> None:
    assert_sound(estimator.estimate(EXTREMES[name]))


@given(st.integers(1, 150), st.integers(1, 150), st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=25)
def test_any_small_image_has_a_sound_estimate(
    estimator: CameraEstimator, height: int, width: int, seed: int
) -> None:
    image = np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)
    assert_sound(estimator.estimate(image))


@pytest.mark.parametrize("name", ["black", "white", "white wall"])
def test_it_is_uncertain_where_the_scene_shows_nothing(
    estimator: CameraEstimator, name: str
) -> None:
    assert estimator.estimate(EXTREMES[name]).std > 20


@pytest.mark.parametrize("effort", [1 / 64, 0.25, 1.0, 8.0])
@pytest.mark.parametrize("shape", [(1, 1, 3), (64, 64, 3), (360, 640, 3)])
def test_any_effort_is_sound(
    estimator: CameraEstimator, effort: float, shape: tuple[int, int, int]
) -> None:
    estimate = estimator.estimate(np.full(shape, 77, np.uint8), effort)
    assert_sound(estimate)
    assert estimate.effort == effort


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((10, 10), np.uint8),
        np.zeros((10, 10, 4), np.uint8),
        np.zeros((10, 10, 3), np.float32),
        np.zeros((0, 10, 3), np.uint8),
    ],
)
def test_it_refuses_what_is_no_image(estimator: CameraEstimator, image: NDArray[np.uint8]) -> None:
    with pytest.raises(InputError):
        estimator.estimate(image)


def test_threads_and_memory_layout_change_nothing(estimator: CameraEstimator) -> None:
    rng = np.random.default_rng(1)
    image = cv2.GaussianBlur(rng.integers(0, 256, (360, 640, 3), np.uint8), (5, 5), 1.0)
    alone = estimator.estimate(image).probabilities
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(estimator.estimate, [image] * 8))
    assert all(np.array_equal(alone, answer.probabilities) for answer in together)
    mirrored = np.ascontiguousarray(image[:, ::-1])[:, ::-1]
    assert np.array_equal(alone, estimator.estimate(mirrored).probabilities)


def test_accuracy_on_real_frames(estimator: CameraEstimator, data: Path) -> None:
    frames = clean_frames(data, "val")[::2]
    answers = measure(estimator.estimate, frames, draws=4)
    assert answers.hits.mean() > 0.85
    assert answers.errors.mean() < 3
    table = answers.table()
    assert table["clean"]["mean_error"] < 1
    assert table["over"]["mean_error"] < 9
    assert all(row["kind_accuracy"] > 0.9 for row in table.values())


def test_confusion_counts_every_answer(estimator: CameraEstimator, data: Path) -> None:
    answers = measure(estimator.estimate, clean_frames(data, "val")[:10], draws=2)
    confusion = answers.confusion()
    assert confusion.sum() == 20
    assert np.trace(confusion) == answers.hits.sum()


def clip_frames(data: Path, clip: str) -> list[NDArray[np.uint8]]:
    path = data / "camera" / "clips" / f"{clip}.mp4"
    if not path.is_file():
        pytest.skip(f"no clip at {path}")
    frames = [frame.image for frame in open_video(path, "camera")]
    return frames[:: max(1, len(frames) // 12)]


@pytest.mark.parametrize("clip", CLIPS)
def test_clean_clips_are_near_zero(estimator: CameraEstimator, data: Path, clip: str) -> None:
    levels = [estimator.estimate(image).level for image in clip_frames(data, clip)]
    assert np.mean(levels) < 5


@pytest.mark.parametrize("clip", CLIPS)
def test_noise_on_clips_is_seen_as_it_is(estimator: CameraEstimator, data: Path, clip: str) -> None:
    for sequence, image in enumerate(clip_frames(data, clip)):
        noise = draw("noise", 60, DrawKey(0, "camera", sequence))
        estimate = estimator.estimate(apply(noise, image))
        assert estimate.kind == "noise"
        assert estimate.level == pytest.approx(60, abs=8)


@pytest.mark.parametrize("clip", CLIPS[:2])
@pytest.mark.parametrize("kind", ["fog", "snow", "motion"])
def test_weather_and_motion_by_day_are_told(
    estimator: CameraEstimator, data: Path, clip: str, kind: str
) -> None:
    images = clip_frames(data, clip)[:4]
    said = {
        level: [
            estimator.estimate(degrade(kind, level, DrawKey(0, clip, sequence), image)[1])
            for sequence, image in enumerate(images)
        ]
        for level in (20.0, 60.0, 100.0)
    }
    assert {estimate.kind for estimate in said[60.0]} == {kind}
    means = [np.mean([estimate.level for estimate in estimates]) for estimates in said.values()]
    assert means == sorted(means)


def test_a_stronger_degradation_is_rated_higher(estimator: CameraEstimator, data: Path) -> None:
    images = clip_frames(data, CLIPS[0])[:3]
    for kind in KINDS:
        means = [
            np.mean(
                [
                    estimator.estimate(apply(draw(kind, level, DrawKey(0, "c", 0)), image)).level
                    for image in images
                ]
            )
            for level in (0, 30, 90)
        ]
        assert means == sorted(means), kind
