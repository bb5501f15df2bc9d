"""What the camera's detector looks at, the cells in which it answers, and what they say."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from models.world.camera import WorldCamera
from models.world.objects import Floats

WIDTH, HEIGHT = 320, 128
"""Of the picture that the network sees, pixels."""
HORIZON = 43.0
"""Row of the horizon in it."""
FOCAL = 0.78 * WIDTH
"""Its focal length, pixels: that of the simulated camera."""
CELL = 4
"""Pixels a side of a cell; the network answers for (HEIGHT / CELL, WIDTH / CELL) cells."""
DEPTH_M = 15.0
"""The depth whose logarithm the network calls 0."""


def strip(image: NDArray[np.uint8], horizon: float) -> NDArray[np.uint8]:
    """Return (HEIGHT, WIDTH, 3) uint8: the image shrunk and cut so that its horizon is at HORIZON.

    Parameters
    ----------
    image:
        (height, width, 3) uint8 BGR of any size.
    horizon:
        Row of the horizon, as a share of the image's height.
    """
    height, width = image.shape[:2]
    rows = max(1, round(height * WIDTH / width))
    small = cv2.resize(image, (WIDTH, rows), interpolation=cv2.INTER_AREA)
    move = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, HORIZON - horizon * rows]])
    cut = cv2.warpAffine(small, move, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(cut, np.uint8)


def horizon_of(camera: WorldCamera) -> float:
    """Return where a simulated camera's horizon is when it does not shake: its calibration."""
    times = np.linspace(0, camera.world.duration_s, 64)
    return float(np.mean([camera.view(t).horizon for t in times])) / camera.height


def places(
    heat: Floats, log_depth: Floats, shift: Floats, threshold: float
) -> tuple[Floats, Floats]:
    """Return (k, 2) places in the camera's coordinates (m) and their scores, the best first.

    A place is where the heat has a peak above the threshold.

    Parameters
    ----------
    heat:
        (rows, columns) score of each cell, 0–1.
    log_depth:
        Logarithm of the depth of what is there, over ``DEPTH_M``.
    shift:
        Cells to the right of the cell's middle at which it is.
    """
    around = cv2.dilate(heat, np.ones((3, 3), np.uint8))
    row, column = np.nonzero((heat >= around) & (heat > threshold))
    score = heat[row, column]
    depth = DEPTH_M * np.exp(np.clip(log_depth[row, column], -3.0, 3.0))
    across = (column + 0.5 + shift[row, column]) * CELL
    left = (WIDTH / 2 - across) * depth / FOCAL
    order = np.argsort(-score, kind="stable")
    return np.stack([depth, left], axis=1)[order], np.asarray(score[order])
