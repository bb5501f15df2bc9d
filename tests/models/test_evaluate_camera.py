from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from numpy.typing import NDArray

from models.degrade.draw import DrawKey
from models.degrade.imager import Gain
from models.degrade.imager import draw as draw_imager
from models.estimate.level import CAMERA_KINDS, LEVELS, Estimate
from models.evaluate.answer_plots import (
    confusion_picture,
    expected_calibration_error,
    reliability_picture,
)
from models.evaluate.camera import (
    COMBINED,
    TUNNEL_FRAMES,
    TUNNEL_PERIOD,
    Answers,
    degrade,
    tunnel_sequence,
)
from models.evaluate.camera_clip import scheduled
from models.evaluate.camera_tables import FURTHER_KINDS, extremes, kinds_table
from models.evaluate.codecs import h264, jpeg
from models.evaluate.restore import denoise, hint, psnr, ssim


def picture(height: int = 96, width: int = 160) -> NDArray[np.uint8]:
    rough = np.random.default_rng(0).integers(0, 256, (9, 16, 3), np.uint8)
    return np.asarray(cv2.resize(rough, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)


@given(st.floats(0.2, 1.0), st.floats(0, 1), st.integers(0, 2**32 - 1))
def test_calibration_error_is_how_far_confidence_is_off(
    confidence: float, share: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    count = 200
    right = rng.random(count) < share
    probabilities = np.full((count, 11), (1 - confidence) / 10)
    probabilities[:, 3] = confidence
    levels = np.where(right, LEVELS[3], LEVELS[7])
    expected = abs(confidence - right.mean())
    assert expected_calibration_error(probabilities, levels) == pytest.approx(expected, abs=1e-9)


def test_the_plots_draw_what_they_are_given() -> None:
    confusion = np.eye(11, dtype=np.intp) * 7
    figure = Figure()
    confusion_picture("c", confusion).draw(figure)
    assert [text.get_text() for text in figure.axes[0].texts] == ["7"] * 11
    figure = Figure()
    reliability_picture("r", np.eye(11), LEVELS).draw(figure)
    assert [text.get_text() for text in figure.axes[0].texts] == ["11"]


@pytest.mark.parametrize("kind", [*CAMERA_KINDS[1:], *COMBINED])
def test_every_kind_that_the_network_tells_can_be_made(kind: str) -> None:
    image = picture()
    true_kind, degraded = degrade(kind, 60.0, DrawKey(0, "c", 0), image)
    assert true_kind in kind.split("+")
    assert degraded.shape == image.shape
    assert not np.array_equal(degraded, image)
    assert degrade(kind, 0.0, DrawKey(0, "c", 0), image) == ("clean", image)


def test_of_two_kinds_either_may_be_the_stronger() -> None:
    image = picture()
    kinds = {degrade("blur+noise", 80.0, DrawKey(n, "c", 0), image)[0] for n in range(20)}
    assert kinds == {"blur", "noise"}


def test_compression_keeps_the_picture() -> None:
    image = picture()
    for coded in (jpeg(image, 90), h264(image, 18)):
        assert coded.shape == image.shape
        assert 20 < psnr(coded[..., 1], image[..., 1]) < 60


def test_a_schedule_rests_between_its_kinds() -> None:
    truth = scheduled(90)
    assert len(truth) == 90
    assert truth[0] == truth[-1] == ("clean", 0.0)
    assert {kind for kind, _ in truth} == {"clean", "blur", "over", "under", "noise"}


def test_denoising_by_the_right_level_restores() -> None:
    clean = np.ascontiguousarray(picture(128, 128)[..., 1])
    noisy = degrade("noise", 30.0, DrawKey(0, "c", 0), np.dstack([clean] * 3))[1][..., 1]
    noisy = np.ascontiguousarray(noisy)
    restored = denoise(noisy, 30.0)
    assert psnr(restored, clean) > psnr(noisy, clean) + 3
    assert ssim(restored, clean) > ssim(noisy, clean)
    assert denoise(noisy, 0.0) is noisy


def test_similarity_of_equals_is_one() -> None:
    plane = picture()[..., 1]
    assert ssim(plane, plane) == pytest.approx(1)
    assert psnr(plane, plane) == 60


def test_only_noise_asks_for_denoising() -> None:
    probabilities = (LEVELS == 40) * 1.0
    assert hint(Estimate(probabilities, {"clean": 0.1, "noise": 0.9})) == 40
    assert hint(Estimate(probabilities, {"clean": 0.1, "blur": 0.9})) == 0


def answers(kinds: list[str], said: list[str]) -> Answers:
    """Return answers to frames of some kinds that were taken for other kinds."""
    count = len(kinds)
    return Answers(
        kinds=np.array([CAMERA_KINDS.index(kind) for kind in kinds]),
        levels=np.full(count, 50.0),
        frames=np.arange(count),
        probabilities=np.eye(11)[[5] * count],
        kind_probabilities=np.eye(len(CAMERA_KINDS))[[CAMERA_KINDS.index(kind) for kind in said]],
    )


def test_kinds_are_counted_by_what_they_were_taken_for() -> None:
    main = answers(["clean", "clean", "blur", "blur"], ["clean", "fog", "blur", "blur"])
    further = {kind: answers([kind], [kind]) for kind in FURTHER_KINDS}
    further["fog"] = answers(["fog"], ["clean"])
    table = kinds_table(main, further)
    rows = {row[0]: dict(zip(table.columns[1:], row[1:], strict=True)) for row in table.rows}
    assert rows["clean"]["clean"] == rows["clean"]["fog"] == 50
    assert rows["blur"]["blur"] == 100
    assert rows["fog"]["clean"] == 100
    assert "over" not in rows


def test_extremes_are_images() -> None:
    for image in extremes().values():
        assert image.dtype == np.uint8
        assert image.ndim == 3


def test_a_tunnels_frames_lie_in_its_transient_at_both_mouths() -> None:
    def gain(number: int) -> float:
        drawn = draw_imager("tunnel", 100.0, DrawKey(0, "", number))
        assert isinstance(drawn, Gain)
        return drawn.gain

    rng = np.random.default_rng(0)
    gains = np.array([gain(tunnel_sequence(rng)) for _ in range(200)])
    stops = np.abs(np.log2(gains))
    assert stops.max() == 4
    assert stops.min() == pytest.approx(4 * np.exp(-(TUNNEL_FRAMES - 1) / 8))
    assert 0.3 < np.mean(gains > 1) < 0.7
    assert [gain(n * TUNNEL_PERIOD) for n in (4, 5)] == [16, 1 / 16]
