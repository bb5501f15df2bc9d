from __future__ import annotations

import itertools
from pathlib import Path

import cv2
import pytest

from drivers.candump import write_candump
from drivers.video_writer import VideoWriter
from models.world.camera import WorldCamera
from models.world.radar import WorldRadar
from models.world.road import World
from tests.node.datasets import write_clouds


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with everything that is understood, and something that is not."""
    folder = tmp_path_factory.mktemp("small")
    world = World(2, 3.0)
    view = WorldCamera(world, width=160, height=90)
    images = [view.frame(number).image for number in range(4)]
    (folder / "day" / "left").mkdir(parents=True)
    cv2.imwrite(str(folder / "day" / "1.jpg"), images[0])
    cv2.imwrite(str(folder / "day" / "left" / "2.png"), images[1])
    with VideoWriter(folder / "drive.mp4", lossless=True) as writer:
        for number, image in enumerate(images):
            writer.write(image, 80_000_000 * number)
    radar = WorldRadar(world)
    write_candump(folder / "radar.log", itertools.islice(radar.frames(), 6))
    write_candump(folder / "zipped.log.gz", itertools.islice(radar.frames(), 3))
    write_clouds(folder / "clouds", [radar.scan(number) for number in range(3)])
    (folder / "README.txt").write_text("not a log")
    return folder
