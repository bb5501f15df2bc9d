"""Classic measures of noise, sharpness and exposure: what the camera's network has to beat."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_IMMERKAER = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
_OCTAVES = 3
_PERCENTILES = (50, 75, 90, 97, 99.5)
_BINS = 64
_SMALLEST = 16
_TINY = 1e-3


def classic_features(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return classic measures of a frame as one vector.

    Of the green channel at full, half and quarter size: the noise after Immerkær ("Fast noise
    variance estimation", CVIU 1996), the variance of the Laplacian, Tenengrad (mean squared
    gradient) and percentiles of the gradient, all as logarithms; of the whole image a histogram of
    64 bins and its extreme percentiles.

    Parameters
    ----------
    image:
        (height, width, 3) uint8 BGR of any size from 1×1 up; mirrored at its edges up to 16 × 16.

    Returns
    -------
    (n,) float32.
    """
    below, right = (max(0, _SMALLEST - length) for length in image.shape[:2])
    if below or right:
        mirrored = cv2.copyMakeBorder(image, 0, below, 0, right, cv2.BORDER_REFLECT_101)
        image = np.asarray(mirrored, np.uint8)
    green = np.ascontiguousarray(image[..., 1])
    parts = []
    octave = green
    for _ in range(_OCTAVES):
        parts.append(_sharpness_and_noise(octave))
        height, width = octave.shape
        half = cv2.resize(octave, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        octave = np.asarray(half, np.uint8)
    counts = np.ravel(cv2.calcHist([green], [0], None, [256], [0, 256])) / green.size
    reached = np.searchsorted(np.cumsum(counts), (0.001, 0.01, 0.99, 0.999)) / 255
    histogram = np.sqrt(counts.reshape(_BINS, -1).sum(axis=1))
    return np.concatenate([*parts, histogram, reached], dtype=np.float32)


def _sharpness_and_noise(plane: NDArray[np.uint8]) -> NDArray[np.float64]:
    noise = np.abs(cv2.filter2D(plane, cv2.CV_32F, _IMMERKAER)).mean() * np.sqrt(np.pi / 2) / 6
    laplacian = cv2.Laplacian(plane, cv2.CV_32F).var()
    across, down = (cv2.Sobel(plane, cv2.CV_32F, *axes) for axes in ((1, 0), (0, 1)))
    gradient = cv2.magnitude(across, down)
    percentiles = np.percentile(gradient[::2, ::2], _PERCENTILES)
    return np.log(np.array([noise, laplacian, (gradient**2).mean(), *percentiles]) + _TINY)
