"""Fixtures that several tests of the models share."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

COLUMNS = ("split", "scene", "file", "source", "licence", "timeofday", "clean")


@pytest.fixture(scope="module")
def camera_drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a data folder with a few generated frames in each split."""
    data = tmp_path_factory.mktemp("drives")
    (data / "camera").mkdir()
    rng = np.random.default_rng(0)
    lines = [",".join(COLUMNS)]
    for split in ("train", "val", "test"):
        for number in range(3):
            rough = rng.integers(0, 256, (12, 20, 3), np.uint8)
            image = cv2.resize(rough, (320, 192), interpolation=cv2.INTER_CUBIC)
            cv2.imwrite(str(data / "camera" / f"{split}{number}.png"), image)
            lines.append(f"{split},{split},{split}{number}.png,drawn:here,none,day,1")
    (data / "camera" / "index.csv").write_text("\n".join(lines))
    return data
