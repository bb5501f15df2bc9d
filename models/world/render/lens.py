"""From the canvas to what a camera delivers: softness, exposure, tone curve, noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from models.world.render.textures import Image

_METERED = 8


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """What is the same in every frame of one camera.

    Attributes
    ----------
    softness:
        Standard deviation of the point spread, pixels.
    mean:
        Mean that the exposure control aims at, counts.
    clipped:
        Share of the brightest that it lets clip.
    bank:
        (n,) int8, a long run of noise to cut frames from.
    """

    softness: float
    mean: float
    clipped: float
    bank: NDArray[np.int8]


def draw_lens(rng: np.random.Generator, pixels: int) -> Lens:
    """Return a random camera's lens, exposure control and sensor."""
    noise = rng.uniform(0.3, 0.9)
    bank = np.rint(rng.normal(0, noise, 3 * pixels + 2**20)).astype(np.int8)
    return Lens(rng.uniform(0.42, 0.6), rng.uniform(82, 122), rng.uniform(0.002, 0.015), bank)


def expose(canvas: Image, lens: Lens, rng: np.random.Generator) -> Image:
    """Return the picture of a canvas."""
    soft = cv2.GaussianBlur(canvas, (0, 0), lens.softness)
    picture = cv2.LUT(soft, _tone_curve(canvas, lens))
    start = int(rng.integers(0, len(lens.bank) - picture.size))
    grain = lens.bank[start : start + picture.size].reshape(picture.shape)
    return np.asarray(cv2.add(picture, grain, dtype=cv2.CV_8U), np.uint8)


def _tone_curve(canvas: Image, lens: Lens) -> Image:
    """Return the table from coded radiance to counts that the exposure control chooses.

    The gain brings all but a small share of the picture below clipping, the exponent brings the
    mean to its target: what exposure time and tone mapping of a camera do together.
    """
    metered = canvas[::_METERED, ::_METERED]
    counts = np.bincount(metered.ravel(), minlength=256) / metered.size
    white = np.searchsorted(np.cumsum(counts), 1 - lens.clipped)
    shares = np.minimum(np.arange(256) / max(float(white), 40.0), 1.0)
    exponent = 1.0
    for _ in range(6):
        mean = max(float(counts @ shares**exponent) * 255, 1.0)
        exponent = float(np.clip(exponent * np.log(lens.mean / 255) / np.log(mean / 255), 0.6, 2.0))
    result: Image = np.rint(255 * shares**exponent).astype(np.uint8)
    return result
