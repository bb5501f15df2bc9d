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
from models.degrade.draw import DrawKey
from models.estimate.camera import CameraEstimator
from models.estimate.exposure import SEEN
from models.estimate.image_features import FEATURES, exposure, image_features
from models.estimate.image_places import PLACES
from models.estimate.level import FRAME_KINDS, OUTER_KINDS
from models.evaluate.camera import TUNNEL_PERIOD, clean_frames, degrade
from models.evaluate.codecs import gray, h264, one_channel
from models.training import camera_frames
from models.training.camera import Perceptron, train
from models.training.camera_frames import DEGRADED_PER_FRAME, make_samples
from models.training.camera_history import (
    OTHER_SHOTS,
    SHOTS,
    Looks,
    changed,
    in_tunnel,
    make_successive,
)
from models.training.camera_network import Successive, favour_clean
from models.training.camera_simulated import simulated_frames
from models.training.camera_vary import vary
from models.training.export import export


def test_quick_training_writes_a_network_that_murk_loads(
    camera_drives: Path, tmp_path: Path
) -> None:
    records: list[dict[str, object]] = []
    output = tmp_path / "new" / "camera.onnx"
    summary = train(camera_drives, output, quick=True, seed=3, report=records.append)
    for name in ("epoch", "tunnel's epoch"):
        told = [record for record in records if name in record]
        assert len(told) == 10
        assert [record[name] for record in told] == sorted(record[name] for record in told)
        assert told[-1]["loss"] < told[0]["loss"]  # type: ignore[operator]
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
    network = Successive(Perceptron(torch.randn(FEATURES), torch.rand(FEATURES) + 0.5))
    network.temperature.fill_(0.7)
    example = {"features": torch.randn(1, FEATURES), "history": torch.randn(1, SEEN)}
    output = tmp_path / "n.onnx"
    export(network, example, output, model="camera", version=1, kinds=("a",))
    with torch.no_grad():
        expected = network(*example.values())
    session = ort.InferenceSession(output)
    inputs = {name: values.numpy() for name, values in example.items()}
    found = session.run(["level", "kind"], inputs)
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours, theirs.numpy(), atol=1e-5)


def test_samples_do_not_depend_on_the_order_of_the_frames(camera_drives: Path) -> None:
    frames = clean_frames(camera_drives, "train")
    one = make_samples(frames, passes=1, seed=1)
    other = make_samples(frames[::-1], passes=1, seed=1)
    assert np.array_equal(one.features[:DEGRADED_PER_FRAME], other.features[-DEGRADED_PER_FRAME:])
    assert np.array_equal(one.levels[:DEGRADED_PER_FRAME], other.levels[-DEGRADED_PER_FRAME:])
    assert np.all((one.kinds == 0) == (one.levels == 0))


def test_samples_of_a_drive_have_histories_and_do_not_depend_on_the_order(
    camera_drives: Path,
) -> None:
    frames = clean_frames(camera_drives, "train")
    (one, seen), (other, seen_too) = (
        make_successive(order, passes=1, seed=1) for order in (frames, frames[::-1])
    )
    of_one_frame = len(SHOTS) + OTHER_SHOTS
    assert len(one.levels) == of_one_frame * len(frames)
    assert np.array_equal(one.features[:of_one_frame], other.features[-of_one_frame:])
    assert np.array_equal(seen[:of_one_frame], seen_too[-of_one_frame:])
    assert np.isfinite(seen).all()
    assert seen.shape == (len(one.levels), seen.shape[1], SEEN)
    assert np.all(seen[..., 0] == 1)
    assert np.sum(one.kinds == FRAME_KINDS.index("tunnel")) == 4 * len(frames)


def test_what_was_otherwise_before_ends_in_what_is() -> None:
    looks = Looks(np.arange(300, 0, -1), np.arange(-300, 0) * 40_000_000)
    now, state = np.zeros((300, 7)), np.ones(7)
    for seed in range(20):
        before = changed(looks, now, [state], np.random.default_rng(seed))
        assert np.all(np.diff(before[:, 0]) <= 0)
    assert not now.any()


def test_a_tunnels_history_goes_back_to_before_its_mouth() -> None:
    rough = np.random.default_rng(0).integers(60, 200, (9, 16, 3), np.uint8)
    clean = cv2.resize(rough, (160, 96), interpolation=cv2.INTER_CUBIC)
    looks = Looks(np.arange(40, 0, -1), np.arange(-40, 0) * 40_000_000)
    before = in_tunnel(looks, clean, level=50.0, sequence=1000 + TUNNEL_PERIOD + 4)
    still = exposure(image_features(clean))
    np.testing.assert_allclose(before[20:36], np.tile(still, (16, 1)), atol=0.05)
    darker = still[:5] - before[36:, :5]
    stops = 2.0 * np.exp(-np.arange(4) / 8)
    np.testing.assert_allclose(darker, np.tile(stops, (5, 1)).T, atol=0.1)


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


def test_odds_of_a_drive_favour_clean_and_doubt_the_weather_and_tunnels() -> None:
    torch.manual_seed(0)
    network = Successive(Perceptron(torch.zeros(FEATURES), torch.ones(FEATURES))).eval()
    features, run = torch.randn(4, FEATURES), torch.ones(4, SEEN)
    with torch.no_grad():
        network.alone.zero_()
        network.in_a_run.zero_()
        before = [network(features, seen)[1] for seen in (run, torch.zeros(4, SEEN))]
        favour_clean(network)
        after = [network(features, seen)[1] for seen in (run, torch.zeros(4, SEEN))]
    changes = [one - other for one, other in zip(after, before, strict=True)]
    tunnels = [change[:, FRAME_KINDS.index("tunnel")] for change in changes]
    assert torch.all(tunnels[1] < tunnels[0] - 1)
    assert torch.all(tunnels[0] < -1)
    for change in changes:
        assert torch.all(change[:, 0] > 2)
        for kind in OUTER_KINDS:
            assert torch.all(change[:, FRAME_KINDS.index(kind)] < -2.9)
        assert torch.all(change[:, FRAME_KINDS.index("blur")].abs() < 1e-5)


def test_what_was_before_changes_nothing_until_it_is_learnt_and_then_a_tunnel_only() -> None:
    torch.manual_seed(0)
    image = Perceptron(torch.zeros(FEATURES), torch.ones(FEATURES)).eval()
    network = Successive(image).eval()
    features, history = torch.randn(4, FEATURES), torch.randn(4, SEEN)
    alone = torch.zeros(4, SEEN)
    with torch.no_grad():
        answer = image.joint(features)
        own = answer.flatten(1).softmax(dim=1)
        level, _ = network(features, history)
        assert torch.allclose(level, network(features, alone)[0], atol=1e-6)
        assert torch.allclose(level.softmax(dim=1), own.view(4, -1, 11).sum(dim=1), atol=1e-6)
        for layer in network.tunnel[::2]:
            torch.nn.init.normal_(layer.weight)
        rows = [network.joint(answer, seen) for seen in (history, alone)]
    assert torch.equal(rows[0][:, :-1], rows[1][:, :-1])
    assert not torch.allclose(rows[0][:, -1], rows[1][:, -1])


def test_a_camera_without_colour_has_one_value_a_pixel() -> None:
    image = np.random.default_rng(0).integers(0, 256, (9, 16, 3), np.uint8)
    colourless = gray(image)
    assert np.all(colourless == colourless[..., :1])
    np.testing.assert_array_equal(one_channel(colourless), colourless)
    degraded = degrade("noise", 50.0, DrawKey(0, "camera", 0), colourless)[1]
    single = one_channel(degraded)
    assert np.all(single == single[..., :1])
    assert 20 < np.std(single[..., 0].astype(float) - colourless[..., 0]) < 60
