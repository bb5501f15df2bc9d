from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from models.estimate.adaptive import GLANCE, LONGEST_REST_S, AdaptiveCamera
from models.estimate.camera import CameraEstimator, CameraHistory
from models.estimate.exposure import MEASURES, ExposureHistory
from models.estimate.lens import LensHistory, LensNetwork
from models.estimate.level import LEVELS, Estimate
from models.evaluate.camera_clip import CLIPS, clip_frames
from models.world.camera import WorldCamera
from models.world.road import World

IMAGE = np.zeros((4, 4, 3), np.uint8)
STEP_NS = 40_000_000


class Scripted(CameraEstimator):
    """Says of each look what it is told to: level and whether it is sure."""

    def __init__(self) -> None:
        self.level, self.sure = 0.0, True
        self.efforts: list[float] = []
        self.histories: list[CameraHistory | None] = []

    def estimate_next(
        self,
        history: CameraHistory | None,
        image: NDArray[np.uint8],
        stamp_ns: int,
        effort: float = 1.0,
    ) -> tuple[Estimate, CameraHistory]:
        self.efforts.append(effort)
        self.histories.append(history)
        probabilities = (
            np.where(self.level == LEVELS, 1.0, 0.0) if self.sure else np.full(11, 1 / 11)
        )
        exposed = np.full(MEASURES, effort)
        if history:
            after = history.exposure.after(stamp_ns, exposed)
        else:
            after = ExposureHistory.begin(stamp_ns, exposed)
        lens = LensHistory.begin(stamp_ns, image)
        said = Estimate(probabilities, {"clean": 1.0}, effort)
        return said, CameraHistory(after, lens, None)


@pytest.fixture
def camera() -> Scripted:
    return Scripted()


def test_steady_and_certain_it_glances_and_rests(camera: Scripted) -> None:
    adaptive = AdaptiveCamera(camera)
    answers = [adaptive.estimate(IMAGE, n * STEP_NS) for n in range(12)]
    looked = [n for n, answer in enumerate(answers) if answer is not None]
    assert camera.efforts[0] == 1.0
    assert set(camera.efforts[1:]) == {GLANCE}
    assert looked[:2] == [0, 1]
    rests = np.diff(looked[1:]) * STEP_NS * 1e-9
    assert len(looked) < 7
    assert rests.max() < LONGEST_REST_S + STEP_NS * 1e-9


def test_unsure_it_looks_whole_at_every_frame(camera: Scripted) -> None:
    camera.sure = False
    adaptive = AdaptiveCamera(camera)
    answers = [adaptive.estimate(IMAGE, n * STEP_NS) for n in range(6)]
    assert None not in answers
    assert camera.efforts == [1.0] * 6


def test_a_glance_that_is_not_sure_becomes_a_whole_look(camera: Scripted) -> None:
    adaptive = AdaptiveCamera(camera)
    adaptive.estimate(IMAGE, 0)
    camera.sure = False
    assert adaptive.estimate(IMAGE, STEP_NS) is not None
    assert camera.efforts == [1.0, GLANCE, 1.0]


def test_a_frame_looked_at_twice_is_taken_in_once_as_it_was_looked_at_last(
    camera: Scripted,
) -> None:
    adaptive = AdaptiveCamera(camera)
    adaptive.estimate(IMAGE, 0)
    camera.sure = False
    adaptive.estimate(IMAGE, STEP_NS)
    adaptive.estimate(IMAGE, 2 * STEP_NS)
    first, glance, whole, then = camera.histories
    assert first is None
    assert glance is not None
    assert whole is not None
    assert whole.exposure is glance.exposure
    assert whole.exposure.stamp_ns == 0
    assert then is not None
    assert then.exposure.stamp_ns == STEP_NS
    assert np.all(then.exposure.averages == 1.0)


def test_a_level_that_moves_gets_no_rest(camera: Scripted) -> None:
    adaptive = AdaptiveCamera(camera)
    for n in range(8):
        camera.level = float(10 * n)
        assert adaptive.estimate(IMAGE, n * STEP_NS) is not None


def test_a_clock_set_back_does_not_stop_it(camera: Scripted) -> None:
    adaptive = AdaptiveCamera(camera)
    adaptive.estimate(IMAGE, 10**12)
    adaptive.estimate(IMAGE, 10**12 + STEP_NS)
    assert adaptive.estimate(IMAGE, 0) is not None


class UnsureAtAGlance(CameraEstimator):
    """Has no idea of the level unless it looks whole."""

    def _answer(
        self, features: NDArray[np.float32], seen: NDArray[np.float32], effort: float
    ) -> Estimate:
        answer = super()._answer(features, seen, effort)
        level = np.full(11, 1 / 11) if effort < 1 else np.eye(11)[0]
        return replace(answer, probabilities=level)


def test_a_lens_is_looked_at_once_where_a_frame_is_looked_at_twice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked: list[int] = []
    real = LensNetwork.log_ratios

    def counted(network: LensNetwork, history: LensHistory) -> NDArray[np.float64]:
        looked.append(history.stamp_ns)
        return real(network, history)

    monkeypatch.setattr(LensNetwork, "log_ratios", counted)
    scene = WorldCamera(World(3, 2.0), width=640, height=360, rate_hz=25.0)
    adaptive = AdaptiveCamera(UnsureAtAGlance())
    for frame in scene.frames():
        estimate = adaptive.estimate(frame.image, frame.stamp_ns)
        assert estimate is None or estimate.effort == 1.0
    assert len(looked) == len(set(looked)) > 3


@pytest.mark.parametrize("clip", CLIPS[:2])
def test_a_clean_clip_by_day_mostly_gets_glances(data: Path, clip: str) -> None:
    adaptive = AdaptiveCamera(CameraEstimator())
    said = [adaptive.estimate(frame.image, frame.stamp_ns) for frame in clip_frames(data, clip)]
    efforts = [estimate.effort if estimate else 0.0 for estimate in said]
    assert np.mean(np.array(efforts) < 1.0) > 0.5
