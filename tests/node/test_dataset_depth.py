from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from dbc.errors import InputError
from models.degrade import weather
from models.degrade.draw import DrawKey
from node.dataset.plan import make_plan
from tests.node.datasets import murk, run_all


def depth_folder(folder: Path, name: str, depth: Any) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".npy":
        np.save(path, depth)
    else:
        cv2.imwrite(str(path), depth)
    return folder


@pytest.mark.parametrize("name", ["left/2.npy", "left/2.png"])
def test_weather_by_a_depth_map(small: Path, tmp_path: Path, name: str) -> None:
    """A wall at 100 m on the left, nothing known on the right, road at 5 m: Koschmieder."""
    metres = np.full((90, 160), 5.0, np.float32)
    metres[:, :50], metres[:, 110:] = 100.0, 0.0
    stored = metres if name.endswith(".npy") else (metres * 256).astype(np.uint16)
    depth = depth_folder(tmp_path / "depth", name, stored)
    source = tmp_path / "in"
    (source / "left").mkdir(parents=True)
    (source / "left" / "2.png").write_bytes((small / "day" / "left" / "2.png").read_bytes())
    result = murk(source, tmp_path / "out", "--kind=fog", "--kind=noise", "--level=50",
                  "--depth", depth, "--horizon=0.4")  # fmt: skip
    assert result.returncode == 0, result.stderr
    image = np.asarray(cv2.imread(str(source / "left" / "2.png")), np.uint8)
    drawn = weather.draw("fog", 50, DrawKey(1, "left", 0), horizon=0.4)
    label = json.loads((tmp_path / "out" / "labels.jsonl").read_text().splitlines()[0])
    assert label["drawn"]["horizon"] == 0.4
    written = cv2.imread(str(tmp_path / "out" / "fog_50" / "left" / "2.png"))
    np.testing.assert_array_equal(written, weather.apply(drawn, image, depth_m=metres))
    contrast = [np.std(written[:, part]) / np.std(image[:, part])
                for part in (np.s_[:50], np.s_[50:110], np.s_[110:])]  # fmt: skip
    assert contrast[0] < 0.1
    assert contrast[1] > 0.7
    assert contrast[2] < 0.01


@pytest.mark.parametrize(
    ("name", "depth", "expected"),
    [
        ("other.npy", np.ones((90, 160)), "no such depth map"),
        ("1.npy", np.ones((90, 100)), "as the image"),
        ("1.npy", np.ones((90, 160), complex), "is no depth"),
        ("1.png", np.ones((90, 160), np.uint8), "16 bits"),
    ],
)
def test_a_depth_map_that_does_not_fit_is_refused(
    small: Path, tmp_path: Path, name: str, depth: Any, expected: str
) -> None:
    folder = depth_folder(tmp_path / "depth", name, depth)
    with pytest.raises(InputError, match=expected):
        run_all(make_plan(small / "day" / "1.jpg", tmp_path / "out", ["rain"], [50], 1,
                          depth=folder))  # fmt: skip


def test_a_depth_map_that_is_no_array_or_of_a_video_is_refused(small: Path, tmp_path: Path) -> None:
    (tmp_path / "1.npy").write_bytes(b"nothing")
    for source, expected in (("day/1.jpg", "cannot be read"), ("drive.mp4", "single images")):
        with pytest.raises(InputError, match=expected):
            run_all(make_plan(small / source, tmp_path / "out", ["snow"], [50], 1, depth=tmp_path))
    with pytest.raises(InputError, match="horizon"):
        make_plan(small / "day", tmp_path / "out", ["fog"], [50], 1, options={"horizon": 2.0})
