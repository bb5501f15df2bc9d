from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from dbc.errors import InputError
from drivers.can_frames import concatenate
from drivers.candump import write_candump
from models.estimate.calibration import Calibration
from models.world.radar import WorldRadar
from models.world.road import World
from node.cli import app
from node.estimator import Estimator


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    folder = tmp_path / "drive"
    folder.mkdir()
    rng = np.random.default_rng(0)
    for number in range(15):
        rough = rng.integers(0, 256, (9, 16, 3), np.uint8)
        image = cv2.resize(rough, (160, 96), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(folder / f"{number}.png"), image)
    return folder


def test_calibrate_writes_a_file_that_the_estimator_takes(drive: Path, tmp_path: Path) -> None:
    file = tmp_path / "front.json"
    arguments = ["calibrate", "camera", str(drive), "--output", str(file), "--json"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    record = json.loads(result.stdout)
    assert record["answers"] == 15
    assert record["output"] == str(file)
    assert Calibration.read(file, "camera").exponent == record["exponent"]
    Estimator("camera", file)
    with pytest.raises(InputError, match="for a camera"):
        Estimator("radar", file)


def test_a_drive_without_such_a_sensor(drive: Path) -> None:
    result = CliRunner().invoke(app, ["calibrate", "radar", str(drive)])
    assert isinstance(result.exception, InputError)
    assert "too few messages" in str(result.exception)


def test_a_correction_that_does_not_help_is_not_written(tmp_path: Path) -> None:
    log = tmp_path / "drive.log"
    write_candump(log, WorldRadar(World(seed=5, duration_s=14.0)).frames())
    file = tmp_path / "front.json"
    arguments = ["calibrate", "radar", str(log), "--output", str(file), "--json"]
    result = CliRunner().invoke(app, arguments)
    assert file.exists() == (result.exit_code == 0)
    if file.exists():
        before, after = json.loads(result.stdout)["surprise"]
        assert after <= before
    else:
        assert "nothing written" in str(result.exception)


def test_a_log_of_two_radars_is_refused(tmp_path: Path) -> None:
    world = World(seed=5, duration_s=1.0)
    both = concatenate([*WorldRadar(world).frames(), *WorldRadar(world, sensor_id=1).frames()])
    log = tmp_path / "two.log"
    write_candump(log, [both.select(np.argsort(both.stamp_ns, kind="stable"))])
    result = CliRunner().invoke(app, ["calibrate", "radar", str(log)])
    assert isinstance(result.exception, InputError)
    assert "radar_0 and radar_1" in str(result.exception)
