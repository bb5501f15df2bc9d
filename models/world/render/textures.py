"""Procedural surfaces: noise of given colour, asphalt, grass."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Gray = NDArray[np.float32]


def clouds(rng: np.random.Generator, height: int, width: int, slope: float) -> Gray:
    """Return periodic noise of mean 0 and deviation 1 whose amplitude falls as f to ``-slope``."""
    fy = np.fft.fftfreq(height, 1 / height).astype(np.float32)[:, None]
    fx = np.fft.rfftfreq(width, 1 / width).astype(np.float32)
    square = np.maximum(fy * fy + fx * fx, 1)
    shaped = np.fft.rfft2(white(rng, height, width)) * square ** np.float32(-slope / 2)
    shaped[0, 0] = 0
    field = np.fft.irfft2(shaped, (height, width))
    result: Gray = (field / field.std()).astype(np.float32)
    return result


def white(rng: np.random.Generator, height: int, width: int) -> Gray:
    """Return independent noise of mean 0 and deviation 1."""
    return rng.standard_normal((height, width), np.float32)


def pyramid(image: Image, levels: int) -> tuple[Image, ...]:
    """Return a square image at full size, half, quarter and so on."""
    side = image.shape[0]
    small = (
        cv2.resize(image, (side >> k, side >> k), interpolation=cv2.INTER_AREA)
        for k in range(levels)
    )
    return tuple(np.asarray(level, np.uint8) for level in small)


def as_factor(field: Gray, contrast: float) -> Image:
    """Return a texture to multiply with: 128 is one, ``contrast`` the relative deviation."""
    result: Image = np.clip(128 * (1 + contrast * field), 0, 255).astype(np.uint8)
    return result


def asphalt(rng: np.random.Generator, side: int = 1024) -> Image:
    """Return a factor texture of asphalt: stones, fine grain and soft blotches."""
    grain = white(rng, side, side)
    stones = cv2.GaussianBlur(white(rng, side, side), (0, 0), 1.2)
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
