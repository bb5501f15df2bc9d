from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("torch")

import onnxruntime as ort
import torch

from dbc.errors import InputError
from models.estimate.camera import CameraEstimator
from models.estimate.image_features import FEATURES, image_features
from models.evaluate.camera import clean_frames
from models.evaluate.codecs import h264
from models.training.camera import Perceptron, train
from models.training.camera_frames import DEGRADED_PER_FRAME, make_samples
from models.training.camera_simulated import simulated_frames
from models.training.camera_vary import vary
from models.training.export import export


def test_quick_training_writes_a_network_that_murk_loads(
    camera_drives: Path, tmp_path: Path
) -> None:
    records: list[dict[str, object]] = []
    output = tmp_path / "new" / "camera.onnx"
    summary = train(camera_drives, output, quick=True, seed=3, report=records.append)
    assert [record["epoch"] for record in records] == sorted(record["epoch"] for record in records)
    assert records[-1]["loss"] < records[0]["loss"]  # type: ignore[operator]
    assert summary["samples"] == (3 + 2) * DEGRADED_PER_FRAME
    estimate = CameraEstimator(output).estimate(np.zeros((100, 100, 3), np.uint8))
    assert estimate.probabilities.sum() == pytest.approx(1)
    card = output.with_suffix(".md").read_text()
    assert "| drawn | none | 3 |" in card
    again = tmp_path / "again.onnx"
    train(camera_drives, again, quick=True, seed=3, report=records.append)
    assert again.read_bytes() == output.read_bytes()


def test_missing_data(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"index\.csv"):
        train(tmp_path, tmp_path / "c.onnx", quick=True, seed=0, report=lambda _: None)


def test_export_says_what_pytorch_says(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = Perceptron(torch.randn(FEATURES), torch.rand(FEATURES) + 0.5)
    network.temperature.fill_(0.7)
    features = torch.randn(1, FEATURES)
    output = tmp_path / "n.onnx"
    export(network, {"features": features}, output, model="camera", version=1, kinds=("a",))
    with torch.no_grad():
        expected = network(features)
    session = ort.InferenceSession(output)
    found = session.run(["level", "kind"], {"features": features.numpy()})
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours, theirs.numpy(), atol=1e-5)


def test_samples_do_not_depend_on_the_order_of_the_frames(camera_drives: Path) -> None:
    frames = clean_frames(camera_drives, "train")
    one = make_samples(frames, passes=1, seed=1)
    other = make_samples(frames[::-1], passes=1, seed=1)
    assert np.array_equal(one.features[:DEGRADED_PER_FRAME], other.features[-DEGRADED_PER_FRAME:])
    assert np.array_equal(one.levels[:DEGRADED_PER_FRAME], other.levels[-DEGRADED_PER_FRAME:])
    assert np.all((one.kinds == 0) == (one.levels == 0))


def test_simulated_frames_are_the_same_whoever_renders_them() -> None:
    first, last = simulated_frames(worlds=1, frames_each=2)
    assert first.name != last.name
    assert np.array_equal(first.read(), simulated_frames(1, 2)[0].read())
    assert not np.array_equal(first.read(), last.read())


def test_variations_avoid_repaired_pixels() -> None:
    repaired = np.zeros((200, 300), np.uint8)
    repaired[:, :120] = 255
    image = np.repeat(repaired[..., np.newaxis], 3, axis=2)
    rng = np.random.default_rng(0)
    shares = [np.mean(vary(image, repaired, rng) > 128) for _ in range(20)]
    blind = [np.mean(vary(image, None, rng) > 128) for _ in range(20)]
    assert np.mean(shares) < np.mean(blind)


def test_h264_keeps_the_picture_and_its_size() -> None:
    rough = np.random.default_rng(0).integers(0, 256, (9, 16, 3), np.uint8)
    image = cv2.resize(rough, (321, 181), interpolation=cv2.INTER_CUBIC)
    coded = h264(image, 23)
    assert coded.shape == (180, 320, 3)
    assert np.abs(coded.astype(int) - image[:180, :320]).mean() < 12
    assert np.array_equal(coded, h264(image, 23))
    assert np.isfinite(image_features(coded)).all()
