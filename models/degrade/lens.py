"""What sticks to the lens: drops that are lenses of their own, and dirt out of focus."""

from __future__ import annotations

from functools import cache, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from models.degrade.camera import Image
from models.degrade.pointwise import Bytes, uniform

DROPS_A_GROUP = 8

_FAR = 8
_COVERED = 0.6
_DIRT_EDGE = 0.35
_DIRT_OPACITY = 0.8


def put_drops(image: Image, seeds: tuple[int, ...], count: int) -> Image:
    """Return the image through ``count`` drops: each is a wide lens that shows the scene inverted.

    Parameters
    ----------
    seeds:
        One a group of ``DROPS_A_GROUP``; the drops are taken from each group in turn.
    """
    height, width = image.shape[:2]
    result = image.copy()
    far = (max(1, width // _FAR), max(1, height // _FAR))
    whole = image[: far[1] * _FAR, : far[0] * _FAR]
    small = np.asarray(cv2.resize(whole, far, interpolation=cv2.INTER_AREA), np.uint8)
    for across, down, size in drops_of(seeds)[:count].tolist():
        radius = radius_of(size, height)
        x, y = int(across * width), int(down * height)
        top, left = max(0, radius - y), max(0, radius - x)
        spot = result[y - radius + top : y + radius, x - radius + left : x + radius]
        cut = np.s_[top : top + spot.shape[0], left : left + spot.shape[1]]
        shown, mask = _seen_in_drop(small, across, down, radius)[cut], _disc(radius)[cut]
        spot[...] = cv2.blendLinear(shown, spot, mask, 1 - mask)
    return result


def drops_of(seeds: tuple[int, ...]) -> NDArray[np.float64]:
    """Return (n, 3): place across and down as shares of the image, and size from 0 to 1."""
    drops = np.stack([uniform(seed, (DROPS_A_GROUP, 3)) for seed in seeds], axis=1)
    return drops.reshape(-1, 3)


def radius_of(size: float, height: int) -> int:
    """Return a drop's radius, pixels, by its size and the image's height."""
    return max(1, round((0.015 + 0.035 * size) * height))


def _seen_in_drop(small: Image, across: float, down: float, radius: int) -> Image:
    """Return (2 radius, 2 radius, 3): a third of the scene around the drop, upside down."""
    height, width = small.shape[:2]
    half = max(1, height // 3)
    x, y = int(across * width), int(down * height)
    part = small[max(0, y - half) : y + half, max(0, x - half) : x + half]
    size = (2 * radius, 2 * radius)
    seen = cv2.resize(part, size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.rotate(seen, cv2.ROTATE_180), np.uint8)


@cache
def _disc(radius: int) -> NDArray[np.float32]:
    """Return (2 radius, 2 radius): 1 inside, falling to 0 over the outer half: out of focus."""
    offset = (np.arange(2 * radius, dtype=np.float32) + 0.5 - radius) / radius
    distance = np.hypot(offset[:, None], offset[None, :])
    return np.asarray(np.clip((1 - distance) * 2, 0, 1), np.float32)


def dirt(seed: int, level: float, shape: tuple[int, ...]) -> Bytes:
    """Return the dirty lens's transmission × 255, (height, width)."""
    through = np.rint(255 * through_dirt(seed, level)).astype(np.uint8)
    smooth = cv2.resize(through, shape[1::-1], interpolation=cv2.INTER_LINEAR_EXACT)
    return np.asarray(smooth, np.uint8)


def through_dirt(seed: int, level: float) -> NDArray[np.float64]:
    """Return the transmission of dirt, (64, 128): where it lies thick it lets a fifth through."""
    covered = np.clip((_COVERED * level / 100 - _dirt_ranks(seed)) / _DIRT_EDGE, 0, 1)
    return np.asarray(1 - _DIRT_OPACITY * covered)


@lru_cache(maxsize=16)
def _dirt_ranks(seed: int) -> NDArray[np.float64]:
    """Return a smooth pattern of which each value in [0, 1) is the share of values below it.

    So the level is the covered share, and blots only grow.
    """
    rough = sum(
        cv2.resize(uniform(seed + k, (cells, 2 * cells)).astype(np.float32), (128, 64),
                   interpolation=cv2.INTER_CUBIC) * weight
        for k, (cells, weight) in enumerate(((4, 1.0), (12, 0.5), (24, 0.25)))
    )  # fmt: skip
    order = np.argsort(np.ravel(rough), kind="stable")
    ranks = np.empty(order.size)
    ranks[order] = np.arange(order.size) / order.size
    return ranks.reshape(64, 128)
