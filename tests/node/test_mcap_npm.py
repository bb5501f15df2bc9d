"""Another implementation, that of Foxglove, reads what we record: ``tests/npm``."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.node.recordings import frame, level, published, record, scan, scene_plan

OLDEST_NODE = 20
NPM = Path(__file__).parents[1] / "npm"


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the program that reads MCAP, with its packages installed beside it."""
    if not (shutil.which("node") and shutil.which("npm")):
        pytest.skip("no node and npm")
    version = subprocess.run(["node", "--version"], capture_output=True, text=True).stdout
    if int(version.lstrip("v").split(".")[0]) < OLDEST_NODE:
        pytest.skip(f"node {version.strip()} is too old for @foxglove/rosmsg2-serialization")
    folder = tmp_path_factory.mktemp("npm")
    for file in NPM.iterdir():
        if file.is_file():
            shutil.copy(file, folder)
    command = ["npm", "install", "--ignore-scripts", "--no-audit", "--no-fund", "--no-package-lock"]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=180)
    except subprocess.TimeoutExpired:
        pytest.skip("npm does not answer")
    if done.returncode:
        pytest.skip(f"npm cannot install: {done.stderr.strip().splitlines()[:1]}")
    return folder / "read_mcap.mjs"


def read(reader: Path, *arguments: object) -> list[dict[str, Any]]:
    done = subprocess.run(
        ["node", str(reader), *map(str, arguments)], capture_output=True, text=True, timeout=120
    )
    assert not done.returncode, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.parametrize("images", [False, True], ids=["zstd", "images and lz4"])
@pytest.mark.parametrize("cut", [False, True], ids=["whole", "cut off"])
def test_foxglove_reads_levels_scans_and_images(
    reader: Path, tmp_path: Path, images: bool, cut: bool
) -> None:
    path = tmp_path / "drive.mcap"
    record(scene_plan(path, record={"images": images}), published(5, {"snr": 60.0}))
    if cut:  # as a kill leaves it: no summary, the last record in part
        content = path.read_bytes()
        path.write_bytes(content[: content.rindex(b"\x0f\x04\0\0\0\0\0\0\0") - 5])
    messages = read(reader, path, *(["--stream"] if cut else []))
    levels = [one for one in messages if one["topic"] == "/murk/front/noise_level"]
    scans = [one for one in messages if one["topic"] == "/murk/front/scan"]
    frames = [one for one in messages if one["topic"] == "/murk/camera/image"]
    assert len(levels) == len(scans) == 5
    assert len(frames) == 5 * images
    for sequence in range(5):
        expected, value = level(scan(sequence)), levels[sequence]["value"]
        assert levels[sequence]["type"] == "murk_msgs/msg/NoiseLevel"
        assert levels[sequence]["sequence"] == value["sequence"] == sequence
        assert value["level"] == expected.level
        assert value["std_dev"] == expected.std
        assert value["probabilities"] == expected.probabilities.tolist()
        assert value["injected_kinds"] == ["snr"]
        assert value["injected_levels"] == [60.0]
        points = scans[sequence]["value"]["points"]
        for name, array in scan(sequence).arrays().items():
            assert np.array_equal(np.array(points[name], array.dtype), array, equal_nan=True), name
    for sequence, one in enumerate(frames):
        pixels = np.array(one["value"]["data"], np.uint8)
        assert np.array_equal(pixels, frame(sequence).image.reshape(-1))
