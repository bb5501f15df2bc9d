"""From the canvas to what a camera delivers: softness, exposure, tone curve, noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from models.world.render.textures import Image

_METERED = 8
_FINE = 16


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
    quality:
        JPEG quality of the stream.
    bank:
        (n,) int16, a long run of noise to cut frames from, 1/16 counts.
    """

    softness: float
    mean: float
    clipped: float
    quality: int
    bank: NDArray[np.int16]


def draw_lens(rng: np.random.Generator, values: int) -> Lens:
    """Return a random camera's lens, exposure control and sensor, for frames of so many values."""
    noise = rng.uniform(0.7, 1.2)
    return Lens(
        softness=rng.uniform(0.42, 0.6),
        mean=rng.uniform(82, 122),
        clipped=rng.uniform(0.002, 0.015),
        quality=int(rng.integers(82, 92)),
        bank=_bank(rng, noise * _FINE, values + 2**20),
    )


def _bank(rng: np.random.Generator, deviation: float, count: int) -> NDArray[np.int16]:
    drawn: NDArray[np.int16] = np.rint(rng.standard_normal(count, np.float32) * deviation).astype(
        np.int16
    )
    return drawn


def expose(canvas: Image, lens: Lens, rng: np.random.Generator) -> Image:
    """Return the picture of a canvas, as it comes out of the camera's JPEG stream.

    From the tone curve on all is done in steps of 1/16 count until the noise is in: a curve over
    whole counts would leave gaps in the histogram.
    """
    soft = cv2.GaussianBlur(canvas, (5, 5), lens.softness)
    picture = cv2.LUT(soft, _tone_curve(canvas, lens))
    start = int(rng.integers(0, len(lens.bank) - picture.size))
    grain = lens.bank[start : start + picture.size].reshape(picture.shape)
    noisy = cv2.add(picture, grain, dtype=cv2.CV_16U)
    counts = cv2.convertScaleAbs(noisy, alpha=1 / _FINE)
    stream = cv2.imencode(".jpg", counts, [cv2.IMWRITE_JPEG_QUALITY, lens.quality])[1]
    return np.asarray(cv2.imdecode(stream, cv2.IMREAD_COLOR), np.uint8)


def _tone_curve(canvas: Image, lens: Lens) -> NDArray[np.uint16]:
    """Return the table from coded radiance to 1/16 counts that the exposure control chooses.

    The gain brings all but a small share of the picture below clipping, the exponent brings the
    mean to its target: what exposure time and tone mapping of a camera do together.
    """
    metered = canvas[::_METERED, ::_METERED]
    shares_of = np.bincount(metered.ravel(), minlength=256) / metered.size
    white = max(float(np.searchsorted(np.cumsum(shares_of), 1 - lens.clipped)), 40.0)
    x = np.minimum(np.arange(256) / white, 1.0)
    exponent = 1.0
    for _ in range(6):
        mean = max(float(shares_of @ x**exponent) * 255, 1.0)
        exponent = float(np.clip(exponent * np.log(lens.mean / 255) / np.log(mean / 255), 0.6, 2.0))
    return np.rint(x**exponent * 255 * _FINE).astype(np.uint16)
