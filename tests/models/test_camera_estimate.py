from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from dbc.errors import InputError
from drivers.frame import Frame
from drivers.video import open_video
from models.degrade.camera import KINDS, apply, draw
from models.degrade.draw import DrawKey
from models.degrade.imager import apply as apply_imager
from models.degrade.imager import draw as draw_imager
from models.estimate.camera import CameraEstimator
from models.estimate.level import CAMERA_KINDS, Estimate
from models.evaluate.camera import TUNNEL_PERIOD, clean_frames, degrade, measure
from models.evaluate.camera_tables import extremes
from models.world.camera import WorldCamera
from models.world.road import World

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
    assert estimator.estimate(EXTREMES[name]).std > 15  # a clean scene's is below one


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


@pytest.fixture(scope="module")
def drive() -> list[Frame]:
    """Return a second and a half of a simulated drive, in the dark from the middle on."""
    camera = WorldCamera(World(5, 1.5), width=640, height=360, rate_hz=20.0)
    gain = draw_imager("tunnel", 60.0, DrawKey(0, "camera", TUNNEL_PERIOD))
    return [
        replace(frame, image=apply_imager(gain, frame.image)) if frame.sequence >= 15 else frame
        for frame in camera.frames()
    ]


def test_the_first_frame_of_a_run_is_one_alone_and_those_after_it_are_not(
    estimator: CameraEstimator, drive: list[Frame]
) -> None:
    look = estimator.follow()
    run = [look(frame.image, frame.stamp_ns).probabilities for frame in drive]
    alone = [estimator.estimate(frame.image).probabilities for frame in drive]
    assert np.array_equal(run[0], alone[0])
    assert not np.array_equal(run[15], alone[15])


def test_runs_do_not_know_of_each_other_and_can_be_repeated(
    estimator: CameraEstimator, drive: list[Frame]
) -> None:
    first, second = estimator.follow(), estimator.follow()
    one, other = [], []
    for ahead, behind in zip(drive, [None, *drive[:-1]], strict=True):
        one.append(first(ahead.image, ahead.stamp_ns).probabilities)
        if behind is not None:
            other.append(second(behind.image, behind.stamp_ns).probabilities)
    assert np.array_equal(one[:-1], other)


@pytest.mark.parametrize("silence_s", [3600, -3600])
def test_after_a_silence_or_with_a_clock_set_back_a_frame_is_one_alone(
    estimator: CameraEstimator, drive: list[Frame], silence_s: int
) -> None:
    look = estimator.follow()
    for frame in drive:
        look(frame.image, frame.stamp_ns)
    image, stamp_ns = drive[0].image, drive[-1].stamp_ns + silence_s * 10**9
    later = look(image, stamp_ns)
    assert np.array_equal(later.probabilities, estimator.estimate(image).probabilities)


def test_a_frame_that_comes_late_or_twice_is_one_alone_and_leaves_no_trace(
    estimator: CameraEstimator, drive: list[Frame]
) -> None:
    history = None
    for frame in drive[:5]:
        _, history = estimator.estimate_next(history, frame.image, frame.stamp_ns)
    for late in (drive[4], drive[2]):
        estimate, after = estimator.estimate_next(history, late.image, late.stamp_ns)
        assert after is history
        alone = estimator.estimate(late.image)
        assert np.array_equal(estimate.probabilities, alone.probabilities)


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


@pytest.mark.parametrize("into", [0, 1])
def test_a_tunnel_is_told_by_what_was_before(
    estimator: CameraEstimator, data: Path, into: int
) -> None:
    mouth, level = 30, 100.0
    look, told = estimator.follow(), []
    with open_video(data / "camera" / "clips" / f"{CLIPS[1]}.mp4", "camera") as source:
        for frame in islice(source, mouth + 20):
            number = (10 + into) * TUNNEL_PERIOD + frame.sequence - mouth
            kind = "tunnel" if frame.sequence >= mouth else "clean"
            key = DrawKey(0, "camera", number)
            image = degrade("tunnel", level if kind == "tunnel" else 0.0, key, frame.image)[1]
            run, alone = look(image, frame.stamp_ns), estimator.estimate(image)
            told.append([each.kind_probabilities["tunnel"] for each in (run, alone)])
            assert kind == "tunnel" or run.level < 3
    run, alone = np.array(told).T
    assert run[:mouth].max() < 0.1
    assert run[mouth + 8 :].mean() > 0.5
    assert run[mouth + 8 :].mean() > alone[mouth + 8 :].mean() + 0.2


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
