"""Clean frames as other cameras, lenses and codecs might have delivered them.

A network that learns from varied frames does not take for a degradation what other cameras and
codecs do to a good frame: cropping, shrinking, gamma, sharpening, a little sensor noise, JPEG and
H.264.
"""

from __future__ import annotations

import cv2
import numpy as np

from models.evaluate.codecs import Image, h264, jpeg


def vary(image: Image, repaired: Image | None, rng: np.random.Generator) -> Image:
    """Return a clean frame as another camera, lens or codec might have delivered it."""
    image = _crop(image, repaired, rng)
    if rng.random() < 0.5:
        image = image[:, ::-1]
    image = np.ascontiguousarray(image)
    if rng.random() < 0.3:
        image = _resize(image, rng.uniform(0.5, 1.05))
    if rng.random() < 0.2:
        image = _gamma(image, rng)
    if rng.random() < 0.15:
        image = _sharpen(image, rng)
    if rng.random() < 0.25:
        image = _sensor_noise(image, rng)
    codec = rng.random()
    if codec < 0.35:
        image = jpeg(image, int(rng.integers(75, 97)))
    elif codec < 0.65:
        image = h264(image, int(rng.integers(16, 35)))
    return image


def _crop(image: Image, repaired: Image | None, rng: np.random.Generator) -> Image:
    """Return a window: where pixels were repaired, the one of eight that holds fewest of them."""
    height, width = image.shape[:2]
    smallest = 0.06 if rng.random() < 0.04 else 0.6
    windows = []
    for _ in range(8 if repaired is not None else 1):
        scale = rng.uniform(smallest, 1)
        h, w = max(1, int(height * scale)), max(1, int(width * scale))
        top, left = rng.integers(height - h + 1), rng.integers(width - w + 1)
        windows.append(np.s_[top : top + h, left : left + w])
    if repaired is None:
        return image[windows[0]]
    return image[min(windows, key=lambda window: float(np.mean(repaired[window] > 0)))]


def _resize(image: Image, factor: float) -> Image:
    method = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    size = [max(1, round(n * factor)) for n in image.shape[1::-1]]
    return np.asarray(cv2.resize(image, size, interpolation=method), np.uint8)


def _gamma(image: Image, rng: np.random.Generator) -> Image:
    gamma, brightest = rng.uniform(0.7, 1.4), 255 * min(1.0, rng.uniform(0.8, 1.4))
    table = np.rint(brightest * np.linspace(0, 1, 256) ** gamma).astype(np.uint8)
    return np.asarray(cv2.LUT(image, table), np.uint8)


def _sharpen(image: Image, rng: np.random.Generator) -> Image:
    amount = rng.uniform(0.2, 1.2)
    soft = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.6, 1.5))
    return np.asarray(cv2.addWeighted(image, 1 + amount, soft, -amount, 0), np.uint8)


def _sensor_noise(image: Image, rng: np.random.Generator) -> Image:
    noise = rng.standard_normal(image.shape, np.float32) * np.float32(rng.uniform(0, 2.5))
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def without_evidence(rng: np.random.Generator) -> Image:
    """Return a frame that shows nothing: black, white or a wall, even or shaded."""
    grey, colour = np.full(3, rng.integers(0, 256)), rng.integers(0, 256, 3)
    colour = rng.choice([np.zeros(3), np.full(3, 255), grey, colour])
    height, width = int(rng.integers(1, 720)), int(rng.integers(1, 1280))
    wall = np.full((height, width, 3), colour, np.float32)
    if rng.random() < 0.5:
        light = np.linspace(1, rng.uniform(0.5, 1.5), width, dtype=np.float32)
        wall *= light[np.newaxis, :, np.newaxis]
    return np.clip(np.rint(wall), 0, 255).astype(np.uint8)


def sense(image: Image, rng: np.random.Generator) -> Image:
    """Return a frame with a sensor's own noise, each channel's its own or the same in all."""
    channels = int(rng.choice([1, 3]))
    noise = rng.standard_normal((*image.shape[:2], channels), np.float32)
    return np.clip(np.rint(image + noise * np.float32(rng.uniform(0.3, 2.5))), 0, 255).astype(
        np.uint8
    )


def compress(image: Image, rng: np.random.Generator) -> Image:
    """Return a degraded frame after the compression that carries it to murk: JPEG or H.264."""
    if rng.random() < 0.5:
        return jpeg(image, int(rng.integers(70, 97)))
    return h264(image, int(rng.integers(16, 29)))
