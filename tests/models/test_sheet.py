from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from models.degrade.kinds import KINDS
from models.evaluate.sheet import CAMERA_LEVELS, draw_camera_sheet, draw_radar_sheet
from models.world.camera import WorldCamera
from models.world.radar import WorldRadar
from models.world.road import World

WORLD = World(4, 6.0)


def test_the_camera_sheet_gets_worse_to_the_right(tmp_path: Path) -> None:
    image = WorldCamera(WORLD, width=480, height=270).frame(40).image
    path = tmp_path / "docs" / "camera.png"
    draw_camera_sheet(image, path, seed=1)
    assert path.stat().st_size < 2**20
    sheet = cv2.imread(str(path))
    assert sheet is not None
    cells = sheet[-103 * len(KINDS["camera"]) :, 96:].astype(float)
    grid = cells.reshape(len(KINDS["camera"]), 103, len(CAMERA_LEVELS), 180, 3)[:, :99, :, :176]
    change = np.abs(grid - grid[:, :, :1]).mean(axis=(1, 3, 4))
    assert (change[:, 0] == 0).all()
    assert (change[:, -1] > 1).all(), dict(zip(KINDS["camera"], change[:, -1], strict=True))
    assert (change[:, -1] > change[:, 1]).all()


def test_the_radar_sheet_is_a_picture(tmp_path: Path) -> None:
    path = tmp_path / "radar.png"
    draw_radar_sheet(WorldRadar(WORLD).scan(45), path, seed=1)
    assert path.stat().st_size < 2**20
    sheet = cv2.imread(str(path))
    assert sheet is not None
    assert sheet.std() > 10
