"""Camera degradations of the first kind: blur, over- and under-exposure, additive noise.

``draw`` turns a level into parameters, ``apply`` applies them to an image. N = level / 100.

=======  =====================================  ===================================
kind     what it does                           100 %
=======  =====================================  ===================================
blur     Gaussian blur, focus                   21 × 21 pixels, σ = 3.5 px
over     light gathered × (1 + 3 N), soft edge  four times the light, saturating
under    light gathered / (1 + 3 N), soft edge  a quarter of the light
noise    additive Gaussian noise per channel    σ = 100 counts (``std_max``)
=======  =====================================  ===================================
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from models.degrade.checks import check_level, check_within
from models.degrade.draw import DrawKey
from models.degrade.pointwise import looked_up, normal_quantiles, strips

Image = NDArray[np.uint8]
Method = Literal["fast", "exact", "published"]

KINDS = ("blur", "over", "under", "noise")

_HALVE_FROM = 11
"""Kernel size from which the fast blur works on the image halved: below, the kernel is as fast."""

_TABLES = 16
_BINOMIAL = np.array([0.25, 0.5, 0.25])
_GAIN_STEPS = 1024
"""Gains are multiples of one of so many: up to four, every product and sum of 255 times the kernel
then has no more than the 24 bits of a float32, whose result no processor rounds another way."""


@dataclass(frozen=True, slots=True)
class Blur:
    """Gaussian blur of ``size`` × ``size`` pixels and standard deviation ``sigma``, pixels."""

    kind: str
    level: float
    size: int
    sigma: float
    method: Method


@dataclass(frozen=True, slots=True)
class Exposure:
    """Light times ``gain``, a multiple of 1/1024, through the kernel [1 2 1; 2 4 2; 1 2 1] / 16."""

    kind: str
    level: float
    gain: float
    method: Method


@dataclass(frozen=True, slots=True)
class Noise:
    """Additive Gaussian noise of ``std`` counts, from the generator seeded by ``seed``."""

    kind: str
    level: float
    std: float
    seed: int
    method: Method


CameraDegradation = Blur | Exposure | Noise


def draw(
    kind: str,
    level: float,
    key: DrawKey,
    *,
    method: Method = "fast",
    std_max: float = 100.0,
) -> CameraDegradation:
    """Draw the parameters of one degradation of one image.

    Parameters
    ----------
    kind, level, key:
        As for every kind: see ``models.degrade.kinds``.
    method:
        ``"fast"``; ``"exact"``, the reference that the fast one approximates, of exposure with the
        same bytes; ``"published"``, for blur and noise only: what the code published with the paper
        does, that is σ = 2 round(10 N) for the blur, and for the noise N(0, N) cast to uint8, whose
        negative draws wrap to 255.
    std_max:
        Standard deviation of the noise at 100 %, counts.

    Raises
    ------
    InputError
        If kind, level, method or ``std_max`` is not one of these.
    """
    check_level(kind, level, KINDS)
    check_within("std_max", std_max, 0.0, 255.0, "counts")
    if method not in ("fast", "exact", "published"):
        raise InputError(f"method {method!r}", "unknown", "fast, exact or published")
    N = level / 100.0
    if kind == "blur":
        steps = round(10 * N)
        sigma = 2.0 * steps if method == "published" else 3 * N + 0.5 if N >= 0.1 else 8 * N
        return Blur(kind, level, max(3, 2 * steps + 1), sigma, method)
    if kind == "noise":
        seed = int(key.generator("camera noise").bit_generator.random_raw())
        return Noise(kind, level, N if method == "published" else N * std_max, seed, method)
    if method == "published":
        raise InputError(f"method of {kind}", "no published variant", "fast or exact")
    gain = 1 + 3 * N if kind == "over" else 1 / (1 + 3 * N)
    return Exposure(kind, level, round(gain * _GAIN_STEPS) / _GAIN_STEPS, method)


def apply(degradation: CameraDegradation, image: Image) -> Image:
    """Return the degraded image; the input stays as it is.

    The result depends on the arguments only, whatever OpenCV's number of threads. At level 0 it
    is the image itself.

    Parameters
    ----------
    degradation:
        What ``draw`` returned.
    image:
        (height, width, 3) uint8.

    Raises
    ------
    InputError
        If the image is anything else.
    """
    check_image(image)
    if degradation.level == 0:
        return image
    match degradation:
        case Blur():
            return _blur(degradation, image)
        case Exposure():
            return _expose(degradation, image)
        case Noise(method="fast"):
            return _add_fast_noise(degradation, image)
        case Noise():
            return _add_drawn_noise(degradation, image)


def check_image(image: Image) -> None:
    """Raise ``InputError`` unless the image is (height, width, 3) uint8 and not empty."""
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
        what = f"shape {image.shape}, {image.dtype}"
        raise InputError("image", what, "expected (height, width, 3) uint8")


def _blur(blur: Blur, image: Image) -> Image:
    if blur.sigma == 0:
        return image
    height, width = image.shape[:2]
    halves = height % 2 == width % 2 == 0 and min(height, width) > 2 * blur.size
    if blur.method == "fast" and blur.size >= _HALVE_FROM and halves:
        return _blur_halved(image, blur.size, blur.sigma)
    blurred = cv2.GaussianBlur(
        image, (blur.size, blur.size), blur.sigma, borderType=cv2.BORDER_REFLECT_101
    )
    return np.asarray(blurred, np.uint8)


def _blur_halved(image: Image, size: int, sigma: float) -> Image:
    """Blur at half the size: at σ ≥ 2 px the other half of the samples adds nothing.

    Halving by 2 × 2 means has variance 1/4 px² and doubling by bilinear interpolation 4/6 px²;
    the Gaussian between them supplies the rest. Within ``size`` / 2 of the border the image is
    mirrored half a pixel off. Every step is in integers: the same bytes on every machine.
    """
    height, width = image.shape[:2]
    small = cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    rest = float(np.sqrt(sigma**2 - 1 / 4 - 4 / 6)) / 2
    half = 2 * (size // 4) + 1
    small = cv2.GaussianBlur(small, (half, half), rest, borderType=cv2.BORDER_REFLECT_101)
    whole = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR_EXACT)
    return np.asarray(whole, np.uint8)


def _expose(exposure: Exposure, image: Image) -> Image:
    border = cv2.BORDER_REFLECT_101
    if exposure.method == "fast":
        exposed = cv2.sepFilter2D(
            image, -1, _BINOMIAL * exposure.gain, _BINOMIAL, borderType=border
        )
        return np.asarray(exposed, np.uint8)
    light = cv2.sepFilter2D(image, cv2.CV_64F, _BINOMIAL, _BINOMIAL, borderType=border)
    return np.asarray(np.clip(np.rint(light * exposure.gain), 0, 255), np.uint8)


def _add_fast_noise(noise: Noise, image: Image) -> Image:
    flat = np.ascontiguousarray(image).reshape(1, -1)
    noisy = np.empty_like(flat)
    values = np.rint(normal_quantiles(_TABLES) * noise.std)
    brighter = np.clip(values, 0, 255).astype(np.uint8)
    darker = np.clip(-values, 0, 255).astype(np.uint8)
    for part, random, table in strips(noise.seed, flat.size, _TABLES):
        here = cv2.add(flat[:, part], looked_up(random, brighter[table]), dst=noisy[:, part])
        cv2.subtract(here, looked_up(random, darker[table]), dst=here)
    return np.asarray(noisy.reshape(image.shape), np.uint8)


def _add_drawn_noise(noise: Noise, image: Image) -> Image:
    generator = np.random.Generator(np.random.SFC64(noise.seed))
    values = generator.standard_normal(image.shape) * noise.std
    if noise.method == "published":
        wrapped = (np.trunc(values).astype(np.int64) & 0xFF).astype(np.uint8)
        return np.asarray(cv2.add(image, wrapped), np.uint8)
    return np.clip(image + np.rint(values), 0, 255).astype(np.uint8)
