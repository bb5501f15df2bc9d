"""Procedural surfaces: noise of given colour, asphalt, grass."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Gray = NDArray[np.float32]


def clouds(rng: np.random.Generator, height: int, width: int, slope: float) -> Gray:
    """Return periodic noise of mean 0 and deviation 1 whose amplitude falls as f to ``-slope``."""
    fy = np.fft.fftfreq(height)[:, None] * height
    fx = np.fft.rfftfreq(width)[None] * width
    radius = np.maximum(np.hypot(fy, fx), 1.0)
    white = np.fft.rfft2(rng.standard_normal((height, width)))
    shaped = white * radius**-slope
    shaped[0, 0] = 0
    field = np.fft.irfft2(shaped, (height, width))
    result: Gray = (field / field.std()).astype(np.float32)
    return result


def as_factor(field: Gray, contrast: float) -> Image:
    """Return a texture to multiply with: 128 is one, ``contrast`` the relative deviation."""
    result: Image = np.clip(128 * (1 + contrast * field), 0, 255).astype(np.uint8)
    return result


def asphalt(rng: np.random.Generator, side: int = 1024) -> Image:
    """Return a factor texture of asphalt: stones, fine grain and soft blotches."""
    grain = rng.standard_normal((side, side)).astype(np.float32)
    stones = cv2.GaussianBlur(rng.standard_normal((side, side)).astype(np.float32), (0, 0), 1.2)
    field = 0.5 * grain + 0.7 * stones / stones.std() + 0.5 * clouds(rng, side, side, 1.0)
    return as_factor(field / field.std(), 0.14)


def grass(rng: np.random.Generator, side: int = 1024) -> Image:
    """Return a factor texture of grass: blades and tufts."""
    field = 0.7 * clouds(rng, side, side, 0.6) + 0.6 * clouds(rng, side, side, 1.3)
    return as_factor(field / field.std(), 0.33)


def stains(rng: np.random.Generator, height: int, width: int) -> Image:
    """Return a factor texture of what happened to a road: patches, seams, stains."""
    field = as_factor(clouds(rng, height, width, 1.2), 0.06)
    for _ in range(height // 40):
        x, y = int(rng.integers(0, width)), int(rng.integers(0, height))
        w, h = int(rng.integers(width // 16, width // 3)), int(rng.integers(4, 60))
        shade = int(rng.integers(105, 145))
        patch = field[y : y + h, x : x + w]
        patch[:] = np.clip(patch.astype(np.int16) + shade - 128, 0, 255).astype(np.uint8)
        cv2.rectangle(field, (x, y), (x + w, y + h), 95, 1)
    for _ in range(height // 25):
        points = np.cumsum(rng.normal(0, 4, (12, 2)), axis=0) + rng.uniform(0, (width, height))
        cv2.polylines(field, [points.astype(np.int32)], False, 88, 1, cv2.LINE_AA)
    return field
