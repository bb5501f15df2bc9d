"""What the lens's network learns from, and that what it learnt reaches its file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="the extra 'train' is not installed")

import torch

from models.estimate.lens import (
    BANDS,
    CHANNELS,
    LOG_RATIOS,
    VERSION,
    LensHistory,
    LensNetwork,
    lens_input,
)
from models.evaluate.camera import CleanFrame
from models.evaluate.codecs import Image
from models.evaluate.report import Table
from models.training.export import export
from models.training.lens import LensSamples, calibrate, make_samples, train
from models.training.lens_network import CLEAN, Lens, fit
from models.training.lens_views import driven_views, simulated_views, successive_views
from models.world.camera import WorldCamera
from models.world.road import World


@dataclass(frozen=True, slots=True)
class Rendered(CleanFrame):
    """A frame of the simulated world in place of one of the data."""

    image: Image = field(default_factory=lambda: np.zeros((1, 1, 3), np.uint8))

    def read(self) -> Image:
        return self.image


@pytest.fixture(scope="module")
def frames() -> list[CleanFrame]:
    camera = WorldCamera(World(7, 2.0), width=320, height=180, rate_hz=2.0)
    return [
        Rendered(
            path=Path(f"{frame.sequence}.png"),
            mask=Path("none.png"),
            scene="a drive",
            source="simulated",
            licence="Apache-2.0",
            condition="day",
            weather="?",
            restricted=False,
            certain=True,
            image=frame.image,
        )
        for frame in camera.frames()
    ]


def test_views_are_of_one_size_and_move_unless_the_vehicle_stands(frames: list[CleanFrame]) -> None:
    moved = []
    for seed in range(12):
        views = driven_views(frames[0], frames, np.random.default_rng(seed))
        assert len({image.shape for image in views.images}) == 1
        assert views.spacing_s > 0
        assert len(views.images) >= 2
        moved.append(not np.array_equal(views.images[0], views.images[1]))
    assert 0 < sum(moved) < len(moved)


def test_frames_in_turn_are_treated_alike(frames: list[CleanFrame]) -> None:
    same = [frames[0]] * 6
    views = successive_views(same, 2.0, np.random.default_rng(1))
    assert views.spacing_s == 2.0
    assert all(np.array_equal(image, views.images[0]) for image in views.images)


def test_simulated_views_move() -> None:
    views = simulated_views(5, np.random.default_rng(1))
    assert not np.array_equal(views.images[0], views.images[-1])


def test_samples_depend_on_the_seed_only(frames: list[CleanFrame]) -> None:
    one, same, other = (make_samples(frames[:2], "train", 1, seed) for seed in (1, 1, 2))
    assert len(one.maps) == len(one.answers) == 2 * 2 * 8
    assert all(np.array_equal(a, b) for a, b in zip(one.maps, same.maps, strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(one.maps, other.maps, strict=True))
    drops = (one.answers > CLEAN) & (one.answers <= LOG_RATIOS[1])
    dirt = one.answers > LOG_RATIOS[1]
    assert drops.sum() == dirt.sum() == len(one.maps) // 4


def spotted(
    rng: np.random.Generator, spots: int
) -> np.ndarray[tuple[int, ...], np.dtype[np.float16]]:
    """Return a map with so many cells that stand out."""
    a_map = rng.normal(0, 0.2, (CHANNELS, BANDS, 100))
    rows, columns = rng.integers(0, BANDS, spots), rng.integers(0, 100, spots)
    a_map[0, rows, columns] -= 6
    return a_map.astype(np.float16)


def test_it_learns_spots_and_its_file_says_the_same(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    counts = rng.choice([0, 0, 40, 400], 256)
    maps = [spotted(rng, count) for count in counts.tolist()]
    answers = np.select([counts == 40, counts == 400], [2, 10], CLEAN).astype(np.int64)
    torch.set_num_threads(1)
    torch.manual_seed(0)
    network = Lens()
    losses: list[object] = []
    fit(network, maps, answers, epochs=7, peak_rate=3e-2, report=lambda r: losses.append(r["loss"]))
    calibrate(network, LensSamples(maps[:100], answers[:100]))
    with torch.no_grad():
        told = network.joint(torch.from_numpy(np.array(maps[:160], np.float32))).argmax(dim=1)
    assert np.mean(told.numpy() == answers[:160]) > 0.9
    file = tmp_path / "lens.onnx"
    example = {"lens": torch.from_numpy(np.array(maps[:1], np.float32))}
    export(
        network,
        example,
        file,
        model="lens",
        version=VERSION,
        outputs=("log_ratios",),
        free={"lens": {3: "columns"}},
    )
    for columns in (20, 100, 256):
        averages = rng.normal(0, 1, (4, BANDS, columns)).astype(np.float32)
        history = LensHistory(0, 10**9, (1, 1), averages)
        from_file = LensNetwork(file).log_ratios(history)
        with torch.no_grad():
            from_torch = network(torch.from_numpy(_input(history)))[0].numpy()
        np.testing.assert_allclose(from_file, from_torch, atol=1e-5, rtol=1e-5)


def test_the_command_writes_a_network_and_its_card(
    frames: list[CleanFrame], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = Table("t", ("frames of", "level"), (("a drive", 60.0),))
    monkeypatch.setattr(
        "models.training.lens.read_splits", lambda *_, **__: {"train": frames, "val": frames[:1]}
    )
    monkeypatch.setattr("models.training.lens.lens_table", lambda *_, **__: told)
    said: list[dict[str, object]] = []
    file = tmp_path / "lens.onnx"
    summary = train(tmp_path, file, quick=True, seed=3, report=said.append)
    assert summary["samples"] == 2 * 8 * len(frames)
    assert [progress["epoch"] for progress in said] == [1]
    assert LensNetwork(file)
    card = file.with_suffix(".md").read_text()
    assert "| a drive | 60 |" in card
    assert "| simulated | Apache-2.0 | 4 |" in card
    assert "murk train lens --data DATA --seed 3" in card
    assert "{" not in card


def _input(history: LensHistory) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return lens_input(history)[np.newaxis]
