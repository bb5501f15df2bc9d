from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sklearn")

from dbc.errors import InputError
from models.evaluate.classics import classic_features
from models.evaluate.opponents import Opponent, opponent_points, read_opponents
from models.training.camera_opponents import OPPONENTS, train_opponent
from models.training.camera_paper import CROP, GROWN, crop, paper_network


def test_the_papers_network_has_the_papers_size() -> None:
    assert sum(weights.numel() for weights in paper_network(900, 1600).parameters()) == 53_187


@pytest.mark.parametrize("shape", [(1, 1, 3), (300, 1000, 3), (1080, 1920, 3)])
def test_a_crop_has_one_size_and_keeps_pixels(shape: tuple[int, int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    assert crop(image).shape == (*CROP, 3)
    assert np.isin(crop(image), image).all()


@pytest.mark.parametrize("shape", [(1, 1, 3), (7, 900, 3), (240, 320, 3)])
def test_classic_features_of_any_size_are_finite(shape: tuple[int, int, int]) -> None:
    features = classic_features(np.zeros(shape, np.uint8))
    assert features.shape == classic_features(np.zeros((50, 60, 3), np.uint8)).shape
    assert np.isfinite(features).all()


@pytest.mark.parametrize("short", [(1, 0), (0, 1)])
def test_the_paper_network_sees_no_less_than_its_last_stage(short: tuple[int, int]) -> None:
    """Seven blocks need 382 pixels: the crop of the training is all but the smallest."""
    paper_network(*CROP)
    paper_network(382, 382)
    with pytest.raises(RuntimeError):
        paper_network(382 - short[0], 382 - short[1])


def test_the_paper_network_grows_to_its_full_depth_and_window() -> None:
    assert [stage.blocks for stage in GROWN] == sorted(stage.blocks for stage in GROWN)
    assert (GROWN[-1].blocks, GROWN[-1].window) == (7, CROP)


@pytest.mark.parametrize("name", ["regressor", "trees", "paper", "paper_as_written", "shrunk_4"])
def test_an_opponent_is_measured_as_the_network_is(
    camera_drives: Path,
    tmp_path: Path,
    name: str,
) -> None:
    output = tmp_path / f"camera_{name}.json"
    train_opponent(name, camera_drives, output, quick=True, seed=0, report=lambda _: None)
    text = output.read_text()
    assert Opponent(**json.loads(text)).tables["test"]["all"]["count"] == 6


def test_unknown_opponent(camera_drives: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="regressor"):
        train_opponent(
            "x", camera_drives, tmp_path / "o.json", quick=True, seed=0, report=lambda _: None
        )


def test_shipped_opponents_are_known_and_worse_than_the_goal() -> None:
    for opponent in read_opponents("camera"):
        assert opponent.name in OPPONENTS
        if not opponent.inputs.startswith("image_features"):
            assert opponent.tables["test"]["all"]["mean_error"] > 2


def test_run_times_of_opponents_go_with_the_machine() -> None:
    slow, fast = (list(opponent_points("camera", us, "points")) for us in (2000.0, 1000.0))
    assert {point.knob for point in slow if point.variant == "opponent trees"} == {"as it is"}
    for one, other in zip(slow, fast, strict=True):
        assert one.run_time_us == pytest.approx(2 * other.run_time_us)
        assert one.error == other.error
