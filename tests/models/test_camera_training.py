from __future__ import annotations

from math import prod
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
from models.estimate.image_places import PLACES
from models.estimate.level import CAMERA_KINDS, OUTER_KINDS
from models.evaluate.camera import clean_frames
from models.evaluate.codecs import h264
from models.training import camera_frames
from models.training.camera import Perceptron, train
from models.training.camera_frames import DEGRADED_PER_FRAME, make_samples
from models.training.camera_network import favour_clean
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


def test_a_place_is_read_alone() -> None:
    image = np.full((900, 1600, 3), 90, np.uint8)
    image[:150, 133:266] = (20, 60, 200)
    places = image_features(image)[: prod(PLACES)].reshape(PLACES)
    brightness, detail, darkest, brightest, colour = places
    assert brightness[0, 1] == pytest.approx(60 / 255)
    assert darkest[0, 1] == pytest.approx(20 / 255)
    assert brightest[0, 1] == pytest.approx(200 / 255)
    assert colour[0, 1] == pytest.approx(np.log(181), rel=1e-3)
    elsewhere = np.ones(PLACES[1:], bool)
    elsewhere[0, 1] = False
    assert np.allclose(brightness[elsewhere], 90 / 255)
    assert np.all(colour[elsewhere] == 0)
    assert np.all(detail[1:] == detail[1, 5])


def test_frames_without_evidence_are_seldom_clean(
    camera_drives: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(camera_frames, "_SHARE_WITHOUT_EVIDENCE", 1.0)
    samples = make_samples(clean_frames(camera_drives, "train") * 4, passes=1, seed=0)
    assert np.mean(samples.levels == 0) < 0.06


def test_odds_of_a_drive_favour_clean_and_doubt_the_weather() -> None:
    torch.manual_seed(0)
    network = Perceptron(torch.zeros(FEATURES), torch.ones(FEATURES)).eval()
    features = torch.randn(4, FEATURES)
    with torch.no_grad():
        before = network.joint(features)
        favour_clean(network)
        change = network.joint(features) - before
    assert torch.all(change[:, 0, 0] > 2.9)
    for kind in OUTER_KINDS:
        assert torch.all(change[:, CAMERA_KINDS.index(kind)] < -2.9)
    assert torch.all(change[:, CAMERA_KINDS.index("blur")].abs() < 1e-5)
