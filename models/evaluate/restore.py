"""The restoration hint: with the level known, the right amount of denoising follows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from models.degrade.camera import apply, draw
from models.degrade.draw import DrawKey
from models.estimate.camera import CameraEstimator
from models.estimate.level import LEVELS, Estimate
from models.evaluate.camera import CleanFrame
from models.evaluate.report import Table

Plane = NDArray[np.uint8]

FIXED_LEVEL = 60.0
"""Level that denoising by a fixed amount takes for granted: the best of 10, 20, … on ``val``."""

_STRENGTH = 1.0
"""Filter strength of non-local means over the noise's standard deviation: the best on ``val``."""

_PATCH, _SEARCH = 5, 15
_CROP = 256
_SSIM_SIGMA = 1.5
_SSIM_C1, _SSIM_C2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2


def denoise(plane: Plane, level: float) -> Plane:
    """Return a plane after non-local means for additive noise of a level (σ = level in counts)."""
    if level <= 0:
        return plane
    strength = _STRENGTH * level
    smooth = cv2.fastNlMeansDenoising(
        plane, h=strength, templateWindowSize=_PATCH, searchWindowSize=_SEARCH
    )
    return np.asarray(smooth, np.uint8)


def hint(estimate: Estimate) -> float:
    """Return the level to denoise by: the estimated one where the kind is noise, else 0."""
    return estimate.level if estimate.kind == "noise" else 0.0


def psnr(one: Plane, other: Plane) -> float:
    """Return the peak signal-to-noise ratio, dB, at most 60: that of images all but equal."""
    error = float(np.mean((one.astype(np.float64) - other) ** 2))
    return float(min(60.0, 10 * np.log10(255**2 / max(error, 1e-12))))


def ssim(one: Plane, other: Plane) -> float:
    """Return the structural similarity (Wang et al., IEEE TIP 2004), 1 for equal planes."""
    x, y = one.astype(np.float64), other.astype(np.float64)
    mean_x, mean_y, xx, yy, xy = (
        cv2.GaussianBlur(plane, (11, 11), _SSIM_SIGMA) for plane in (x, y, x * x, y * y, x * y)
    )
    covariance = xy - mean_x * mean_y
    variances = xx - mean_x**2 + yy - mean_y**2
    similarity = (2 * mean_x * mean_y + _SSIM_C1) * (2 * covariance + _SSIM_C2)
    return float(
        np.mean(similarity / ((mean_x**2 + mean_y**2 + _SSIM_C1) * (variances + _SSIM_C2)))
    )


def restoration_table(estimator: CameraEstimator, frames: Sequence[CleanFrame]) -> Table:
    """Return PSNR and SSIM against the clean frame: noise at every level, denoised four ways.

    Denoised is the green channel of the frame's middle; the level is estimated from the frame.
    """
    scores: dict[str, list[tuple[float, float]]] = {}
    for frame, level in _cases(frames):
        image = frame.read()
        noise = draw("noise", level, DrawKey(0, frame.name, 0))
        noisy = apply(noise, image)
        clean, given = _middle(image), _middle(noisy)
        ways = {
            "none": 0.0,
            f"fixed, for {FIXED_LEVEL:g} %": FIXED_LEVEL,
            "by the estimated level": hint(estimator.estimate(noisy)),
            "by the true level": level,
        }
        for way, amount in ways.items():
            restored = denoise(given, amount)
            scores.setdefault(way, []).append((psnr(restored, clean), ssim(restored, clean)))
    rows = tuple(
        (way, float(np.mean([one for one, _ in pairs])), float(np.mean([two for _, two in pairs])))
        for way, pairs in scores.items()
    )
    title = "Restoration hint: denoising by the estimated level, noise at all eleven levels"
    return Table(title, ("denoising", "PSNR, dB (clean counts 60)", "SSIM"), rows)


def _cases(frames: Sequence[CleanFrame]) -> Iterator[tuple[CleanFrame, float]]:
    for index, frame in enumerate(frames):
        yield frame, float(LEVELS[index % len(LEVELS)])


def _middle(image: NDArray[np.uint8]) -> Plane:
    height, width = image.shape[:2]
    top, left = max(0, (height - _CROP) // 2), max(0, (width - _CROP) // 2)
    return np.ascontiguousarray(image[top : top + _CROP, left : left + _CROP, 1])
