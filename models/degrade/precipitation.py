"""What falls through the picture, as a layer of light: streaks of rain, flakes of snow."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from models.degrade.pointwise import Bytes, uniform

MOST_STREAKS = 1200
MOST_FLAKES = 1500
"""At 100 %; fewer are the first so many of these."""


def streaks(seed: int, count: int, slant_deg: float, shape: tuple[int, ...]) -> Bytes:
    """Return the light of rain, (height, width): most streaks are far, short and faint.

    Parameters
    ----------
    seed, count:
        Of the streaks.
    slant_deg:
        Direction of fall against the vertical.
    shape:
        Of the image.
    """
    layer = np.zeros(shape[:2], np.uint8)
    falling = _fall(seed, count, MOST_STREAKS, shape)
    slant = math.radians(slant_deg)
    down = np.array([math.sin(slant), math.cos(slant)]) * shape[0]
    for low, high, length, light, thickness in (
        (0.0, 0.7, 0.015, 35, 1),
        (0.7, 0.95, 0.04, 50, 1),
        (0.95, 1.0, 0.09, 40, 2),
    ):
        chosen = falling[(falling[:, 2] >= low) & (falling[:, 2] < high)]
        _lines(layer, chosen[:, :2], length * down, light, thickness, cv2.LINE_AA)
    return layer


def flakes(seed: int, count: int, slant_deg: float, shape: tuple[int, ...]) -> Bytes:
    """Return the light of snow as ``streaks`` does: a few flakes are near and out of focus."""
    layer = np.zeros(shape[:2], np.uint8)
    falling = _fall(seed, count, MOST_FLAKES, shape)
    slant = math.radians(slant_deg)
    down = np.array([math.sin(slant), math.cos(slant)]) * shape[0] * 0.004
    for low, high, light, size in (
        (0.9, 1.0, 60, 0.009),
        (0.6, 0.9, 90, 0.004),
        (0.0, 0.6, 110, 0),
    ):
        chosen = falling[(falling[:, 2] >= low) & (falling[:, 2] < high)]
        _lines(layer, chosen[:, :2], down, light, max(1, round(size * shape[0])), cv2.LINE_8)
    return np.asarray(cv2.blur(layer, (3, 3)), np.uint8)


def _fall(seed: int, count: int, most: int, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return (count, 3): x and y over the whole image, and a uniform number, of what falls."""
    share = uniform(seed, (most, 3))[:count]
    return share * (shape[1], shape[0], 1.0)


def _lines(layer: Bytes, start: NDArray[np.float64], way: NDArray[np.float64], light: int,
           thickness: int, line: int) -> None:  # fmt: skip
    ends = np.rint(np.stack([start, start + way], axis=1) * 16).astype(np.int32)
    cv2.polylines(layer, list(ends), False, light, thickness, line, 4)
