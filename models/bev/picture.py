"""What the camera's detector looks at: a strip around the horizon, and where its cells lie."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT = 320, 128
"""Of the network's input, pixels."""
HORIZON = 43.0
"""Row of the horizon in the network's input."""
CELL = 4
"""Pixels a side of a cell of the network's output."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """A camera that looks level along the road.

    Attributes
    ----------
    focal:
        Focal length, as a share of the image's width.
    horizon:
        Row of the horizon, as a share of the image's height.
    """

    focal: float
    horizon: float


def strip(image: NDArray[np.uint8], calibration: Calibration) -> NDArray[np.uint8]:
    """Return (HEIGHT, WIDTH, 3) uint8: the image shrunk and cut so that its horizon is at HORIZON.

    Parameters
    ----------
    image:
        (height, width, 3) uint8 BGR of any size.
    """
    height, width = image.shape[:2]
    scale = WIDTH / width
    small = cv2.resize(image, (WIDTH, max(1, round(height * scale))), interpolation=cv2.INTER_AREA)
    down = HORIZON - calibration.horizon * height * scale
    move = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, down]])
    moved = cv2.warpAffine(small, move, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, np.uint8)
