from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from dbc.errors import InputError
from models.estimate.camera import CameraEstimator
from models.estimate.exposure import SEEN, UNSEEN
from models.estimate.image_features import FEATURES, image_features
from models.training.camera import train
from models.training.camera_tune import find_drives, shipped_network


def test_the_shipped_network_is_taken_up_where_it_stands() -> None:
    image = np.random.default_rng(0).integers(0, 256, (90, 160, 3), np.uint8)
    network = shipped_network().eval()
    with torch.no_grad():
        features = torch.from_numpy(image_features(image)).reshape(1, FEATURES)
        level, _ = network(features, torch.from_numpy(UNSEEN).reshape(1, SEEN))
    shipped = CameraEstimator().estimate(image).probabilities
    np.testing.assert_allclose(level[0].softmax(dim=0).numpy(), shipped, atol=1e-5)


def test_own_drives_tune_it_and_are_judged_by_frames_left_out(tmp_path: Path) -> None:
    folder = tmp_path / "drives" / "monday"
    folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    for number in range(8):
        rough = rng.integers(0, 256, (9, 16, 3), np.uint8)
        image = cv2.resize(rough, (160, 96), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(folder / f"{number}.png"), image)
    assert find_drives(tmp_path / "drives") == [folder]
    output = tmp_path / "mine.onnx"
    records: list[dict[str, object]] = []
    summary = train(tmp_path / "drives", output, quick=True, seed=0, report=records.append)
    assert summary["frames"] == 6
    assert records[0]["held_out"] == 2
    assert set(summary) == {"output", "frames", "before", "after"}
    assert "| before |" in output.with_suffix(".md").read_text()
    estimate = CameraEstimator(output).estimate(np.zeros((50, 50, 3), np.uint8))
    assert estimate.probabilities.sum() == pytest.approx(1)


def test_too_short_a_drive_is_refused(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "one.png"), np.zeros((20, 20, 3), np.uint8))
    with pytest.raises(InputError, match="frames"):
        train(tmp_path, tmp_path / "o.onnx", quick=True, seed=0, report=lambda _: None)
