"""Light scattered in the air between camera and scene: Koschmieder's law.

Without a depth map the scene is a street: depth grows toward the horizon from below and from
above. What glows in the air is the scene's own light, so that fog is grey by day and dark at
night.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from models.degrade.camera import Image
from models.degrade.pointwise import Bytes, uniform

CONTRAST_LIMIT = 3.912
"""-ln 0.02: extinction × visibility by Koschmieder."""

FARTHEST_M = 250.0
"""Depth in a depth map where it says nothing, as in the sky."""

HORIZON = 0.45
"""Where the horizon is taken to be, as a share of the image's height from its top."""

_CAMERA_HEIGHT_M = 1.5
_CANOPY_M = 25.0
_AHEAD_M = 80.0
_FOCAL_OF_WIDTH = 0.8
_COARSE = 4
_LIGHT_CELL = 16


@dataclass(frozen=True, slots=True)
class Haze:
    """Airlight in front of the scene.

    Attributes
    ----------
    extinction:
        1/m.
    airlight:
        Of the scene's own light, see ``scene_light``.
    patchiness:
        Relative variation of the extinction from bank to bank.
    drift:
        How far the banks have moved, in cells of their pattern.
    seed:
        Of the pattern.
    """

    extinction: float
    airlight: float
    patchiness: float = 0.0
    drift: float = 0.0
    seed: int = 0


def scene_light(image: Image, horizon: float = HORIZON) -> float:
    """Return how bright the air of the scene is, counts.

    The air is seen where the darkest colour channel is brightest (He, Sun, Tang, "Single image
    haze removal using dark channel prior", CVPR 2009). This is the median brightness of that fifth
    of the cells of 16 × 16 pixels above the horizon: a lamp at night fills few of them.
    """
    height, width = image.shape[:2]
    above = image[: max(1, round(horizon * height))]
    across, down = max(1, width // _LIGHT_CELL), max(1, len(above) // _LIGHT_CELL)
    sparse = cv2.resize(above, (4 * across, 4 * down), interpolation=cv2.INTER_NEAREST)
    cells = cv2.resize(sparse, (across, down), interpolation=cv2.INTER_AREA)
    brightest = np.argsort(cells.min(axis=2), axis=None)[-math.ceil(across * down / 5) :]
    light = np.sort(cells.reshape(-1, 3)[brightest].mean(axis=1))
    return float(light[len(light) // 2])


def default_depth(height: int, horizon: float = HORIZON) -> NDArray[np.float64]:
    """Return (height,) depth by row, m, of a street, for square pixels and an image of 16:9.

    A flat road 1.5 m below the camera, a canopy of trees and houses 25 m above it, and at the
    horizon what stands 80 m ahead: 1 / depth is the root of the sum of their squares.
    """
    focal = _FOCAL_OF_WIDTH * height * 16 / 9
    below = np.arange(height) + 0.5 - horizon * height
    away = np.where(below > 0, _CAMERA_HEIGHT_M, _CANOPY_M) * focal
    return np.asarray(1 / np.hypot(1 / _AHEAD_M, below / away))


def transmission(
    haze: Haze, horizon: float, shape: tuple[int, ...], depth_m: NDArray[np.float32] | None
) -> Bytes:
    """Return exp(-extinction × depth) × 255, (height, width) uint8.

    Of banks of fog a picture of a quarter the size is enough, but for a depth map.
    """
    height, width = shape[:2]
    if depth_m is None:
        rows = -(-height // _COARSE) if haze.patchiness else height
        depth = default_depth(rows, horizon)[:, None]
    else:
        usable = np.isfinite(depth_m) & (depth_m > 0)
        depth = np.minimum(np.where(usable, depth_m, FARTHEST_M), FARTHEST_M).astype(np.float64)
    exponent = -haze.extinction * depth
    if haze.patchiness:
        columns = -(-width // _COARSE) if depth_m is None else width
        exponent = exponent * (1 + haze.patchiness * banks_of_fog(haze, len(depth), columns))
    through = np.rint(np.exp(exponent) * 255).astype(np.uint8)
    whole = cv2.resize(through, (width, height), interpolation=cv2.INTER_LINEAR_EXACT)
    return np.asarray(whole, np.uint8)


def banks_of_fog(haze: Haze, height: int, width: int) -> NDArray[np.float64]:
    """Return a smooth pattern within [-1, 1] that drifts sideways and never jumps."""
    pattern = uniform(haze.seed, (6, 64)) * 2 - 1
    place = (np.arange(12) + haze.drift) % 64
    left = place.astype(np.intp)
    part = (place - left)[None, :]
    cells = pattern[:, left] * (1 - part) + pattern[:, (left + 1) % 64] * part
    smooth = cv2.resize(cells.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(smooth, -1, 1), np.float64)
