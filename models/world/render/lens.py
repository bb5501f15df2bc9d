"""From the canvas to what a camera delivers: softness, exposure, tone curve, noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from models.world.render.textures import Image

_METERED = 8


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """What is the same in every frame of one camera.

    Attributes
    ----------
    softness:
        Standard deviation of the point spread, pixels.
    target:
        Mean luminance that the exposure control aims at, counts.
    noise:
        Standard deviation of the noise at mid-gray, counts.
    bank:
        (n,) int8, a long run of noise to cut frames from.
    """

    softness: float
    target: float
    noise: float
    bank: np.ndarray[tuple[int, ...], np.dtype[np.int8]]


def draw_lens(rng: np.random.Generator, pixels: int) -> Lens:
    """Return a random camera's lens, exposure control and sensor."""
    noise = rng.uniform(0.9, 1.6)
    bank = np.rint(rng.normal(0, noise, 3 * pixels + 2**20)).astype(np.int8)
    return Lens(rng.uniform(0.55, 0.75), rng.uniform(95, 130), noise, bank)


def expose(canvas: Image, lens: Lens, rng: np.random.Generator) -> Image:
    """Return the picture of a canvas."""
    soft = cv2.GaussianBlur(canvas, (0, 0), lens.softness)
    curve = _tone_curve(_gain(canvas, lens.target))
    picture = cv2.LUT(soft, curve)
    start = int(rng.integers(0, len(lens.bank) - picture.size))
    grain = lens.bank[start : start + picture.size].reshape(picture.shape)
    return np.asarray(cv2.add(picture, grain, dtype=cv2.CV_8U), np.uint8)


def _gain(canvas: Image, target: float) -> float:
    """Return the factor that brings the metered mean to the target."""
    metered = canvas[::_METERED, ::_METERED].mean()
    return float(np.clip(target / max(metered, 1.0), 0.5, 3.5))


def _tone_curve(gain: float) -> Image:
    """Return the table from coded radiance to counts: gain, a soft shoulder, then clipping."""
    x = np.arange(256) / 255 * gain
    toe = x**1.12
    shoulder = np.where(toe < 0.75, toe, 0.75 + 0.33 * np.tanh((toe - 0.75) / 0.33))
    result: Image = np.clip(np.rint(shoulder * 255), 0, 255).astype(np.uint8)
    return result
