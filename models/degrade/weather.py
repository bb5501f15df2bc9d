"""Weather in front of the camera and on its lens. N = level / 100.

=====  ====================================  ===========================================
kind   what it does                          100 %
=====  ====================================  ===========================================
fog    Koschmieder's law, drifting banks     meteorological visibility of 50 m
rain   streaks, and the haze of the rain     100 mm/h: extinction of 6.8 / km, 1,200
                                             streaks an image
snow   flakes, and their haze                visibility of 150 m, 1,500 flakes an image
drops  drops on the lens: each shows the     64 drops of 1 to 4 % of the image's height
       scene small and upside down
dirt   blots on the lens, out of focus       three fifths of the lens covered
=====  ====================================  ===========================================

Without a depth map the scene is a flat road under a canopy of trees and buildings: depth grows
toward the horizon from below and from above. Drops and dirt stay on the lens from frame to frame;
banks of fog drift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from models.degrade.camera import Image, check_image
from models.degrade.checks import check_level
from models.degrade.draw import DrawKey
from models.degrade.pointwise import Bytes, veil

KINDS = ("fog", "rain", "snow", "drops", "dirt")

CONTRAST_LIMIT = 3.912
"""-ln 0.02: extinction × visibility by Koschmieder."""

FARTHEST_M = 250.0

_HORIZON = 0.45
_CAMERA_HEIGHT_M = 1.5
_CANOPY_M = 10.0
_FOCAL_OF_WIDTH = 0.8
_COARSE = 4
_FAR = 8
_DROP_GROUPS = 8
_DROPS_A_GROUP = 8
_DROP_LIFE = 160
_COVERED = 0.6


@dataclass(frozen=True, slots=True)
class Haze:
    """Airlight in front of the scene.

    Attributes
    ----------
    extinction:
        1/m.
    airlight:
        Counts.
    patchiness:
        Relative variation of the extinction from bank to bank.
    drift:
        How far the banks have moved, in cells of their pattern.
    seed:
        Of the pattern.
    """

    extinction: float
    airlight: float
    patchiness: float = 0.0
    drift: float = 0.0
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Weather:
    """Drawn parameters of weather in one image.

    Attributes
    ----------
    haze:
        Fog, or what rain and snow veil.
    count:
        Streaks, flakes or drops.
    slant_deg:
        Direction of fall against the vertical.
    seeds:
        Of what falls in this image, of each group of drops, or of the dirt.
    """

    kind: str
    level: float
    haze: Haze | None
    count: int
    slant_deg: float
    seeds: tuple[int, ...]


def draw(kind: str, level: float, key: DrawKey) -> Weather:
    """Draw the parameters of one kind of weather in one image.

    Raises
    ------
    InputError
        If the kind is not one of ``KINDS`` or the level is not 0 to 100 %.
    """
    check_level(kind, level, KINDS)
    N = level / 100
    lasting = DrawKey(key.seed, key.sensor, 0).generator(f"weather {kind}")
    airlight, slant = lasting.uniform(180, 220), lasting.uniform(-15, 15)
    seed = _seed(key, f"weather {kind} now")
    lasting_seed = int(lasting.bit_generator.random_raw())
    match kind:
        case "fog":
            extinction = N * CONTRAST_LIMIT / 50.0
            haze = Haze(extinction, airlight, 0.5, key.sequence * 0.02, lasting_seed)
            return Weather(kind, level, haze, 0, 0.0, ())
        case "rain":
            extinction = 0.312e-3 * (100.0 * N) ** 0.67
            return Weather(kind, level, Haze(extinction, airlight), round(1200 * N), slant, (seed,))
        case "snow":
            haze = Haze(N * CONTRAST_LIMIT / 150.0, airlight)
            return Weather(kind, level, haze, round(1500 * N), slant, (seed,))
        case "drops":
            count = round(_DROP_GROUPS * _DROPS_A_GROUP * N)
            return Weather(kind, level, None, count, 0.0, _drop_seeds(key))
        case _:
            return Weather(kind, level, None, 0, 0.0, (lasting_seed,))


def _seed(key: DrawKey, purpose: str) -> int:
    return int(key.generator(purpose).bit_generator.random_raw())


def _drop_seeds(key: DrawKey) -> tuple[int, ...]:
    """Return a seed a group of drops; each group is wiped away and comes anew in its turn."""
    seeds = []
    for group in range(_DROP_GROUPS):
        life = (key.sequence + group * _DROP_LIFE // _DROP_GROUPS) // _DROP_LIFE
        seeds.append(_seed(DrawKey(key.seed, key.sensor, life), f"weather drops {group}"))
    return tuple(seeds)


def apply(weather: Weather, image: Image, *, depth_m: NDArray[np.float32] | None = None) -> Image:
    """Return the image in this weather; the input stays as it is. Level 0 is the image itself.

    Parameters
    ----------
    weather:
        What ``draw`` returned.
    image:
        (height, width, 3) uint8.
    depth_m:
        (height, width), m, for the haze; what is not a number above 0 is as far as can be.

    Raises
    ------
    InputError
        If the image or the depth map has another shape or type.
    """
    check_image(image)
    if depth_m is not None and depth_m.shape != image.shape[:2]:
        raise InputError("depth map", f"shape {depth_m.shape}", f"expected {image.shape[:2]}")
    if weather.level == 0:
        return image
    result = image
    if weather.haze is not None:
        result = veil(
            image, _transmission(weather.haze, image.shape, depth_m), weather.haze.airlight
        )
    match weather.kind:
        case "rain":
            return _add_light(result, _streaks(weather, result.shape))
        case "snow":
            return _add_light(result, _flakes(weather, result.shape))
        case "drops":
            return _put_drops(weather, result)
        case "dirt":
            return veil(image, _dirt(weather, image.shape), 50.0)
        case _:
            return result


def default_depth(height: int) -> NDArray[np.float64]:
    """Return (height,) depth by row, m: a flat road 1.5 m below the camera, trees 10 m above it.

    For square pixels and an image of 16:9; at most ``FARTHEST_M``.
    """
    focal = _FOCAL_OF_WIDTH * height * 16 / 9
    below = np.arange(height) + 0.5 - _HORIZON * height
    away = np.where(below > 0, _CAMERA_HEIGHT_M, _CANOPY_M) * focal
    return np.asarray(np.minimum(away / np.maximum(np.abs(below), 1e-9), FARTHEST_M))


def _transmission(haze: Haze, shape: tuple[int, ...], depth_m: NDArray[np.float32] | None) -> Bytes:
    """Return exp(-extinction × depth) × 255, (height, width) uint8; coarse without a depth map."""
    height, width = shape[:2]
    if depth_m is None:
        rows, columns = -(-height // _COARSE), -(-width // _COARSE)
        depth = default_depth(rows)[:, None]
    else:
        rows, columns = height, width
        usable = np.isfinite(depth_m) & (depth_m > 0)
        depth = np.minimum(np.where(usable, depth_m, FARTHEST_M), FARTHEST_M).astype(np.float64)
    exponent = np.broadcast_to(-haze.extinction * depth, (rows, columns))
    if haze.patchiness:
        exponent = exponent * (1 + haze.patchiness * _banks_of_fog(haze, rows, columns))
    through = np.rint(np.exp(exponent) * 255).astype(np.uint8)
    whole = cv2.resize(through, (width, height), interpolation=cv2.INTER_LINEAR_EXACT)
    return np.asarray(whole, np.uint8)


def _banks_of_fog(haze: Haze, height: int, width: int) -> NDArray[np.float64]:
    """Return a smooth pattern within (-1, 1) that drifts sideways and never jumps."""
    pattern = _uniform(haze.seed, (6, 64)) * 2 - 1
    place = (np.arange(12) + haze.drift) % 64
    left = place.astype(np.intp)
    part = (place - left)[None, :]
    cells = pattern[:, left] * (1 - part) + pattern[:, (left + 1) % 64] * part
    smooth = cv2.resize(cells.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(smooth, np.float64)


def _uniform(seed: int, shape: tuple[int, ...]) -> NDArray[np.float64]:
    raw = np.random.SFC64(seed).random_raw(math.prod(shape))
    return np.asarray((raw >> 11).reshape(shape) * 2.0**-53, np.float64)


def _add_light(image: Image, layer: Bytes) -> Image:
    return np.asarray(cv2.add(image, cv2.merge([layer] * 3)), np.uint8)


def _fall(weather: Weather, shape: tuple[int, ...], most: int) -> NDArray[np.float64]:
    """Return (count, 3): x and y over the whole image, and a uniform number, of what falls."""
    share = _uniform(weather.seeds[0], (most, 3))[: weather.count]
    return share * (shape[1], shape[0], 1.0)


def _lines(layer: Bytes, start: NDArray[np.float64], way: NDArray[np.float64], light: int,
           thickness: int) -> None:  # fmt: skip
    ends = np.rint(np.stack([start, start + way], axis=1) * 16).astype(np.int32)
    cv2.polylines(layer, list(ends), False, light, thickness, cv2.LINE_AA, 4)


def _streaks(weather: Weather, shape: tuple[int, ...]) -> Bytes:
    """Draw the streaks of rain: most of them far, short and faint."""
    layer = np.zeros(shape[:2], np.uint8)
    falling = _fall(weather, shape, 1200)
    slant = math.radians(weather.slant_deg)
    down = np.array([math.sin(slant), math.cos(slant)]) * shape[0]
    for low, high, length, light, thickness in (
        (0.0, 0.7, 0.015, 35, 1),
        (0.7, 0.95, 0.04, 50, 1),
        (0.95, 1.0, 0.09, 40, 2),
    ):
        chosen = falling[(falling[:, 2] >= low) & (falling[:, 2] < high)]
        _lines(layer, chosen[:, :2], length * down, light, thickness)
    return layer


def _flakes(weather: Weather, shape: tuple[int, ...]) -> Bytes:
    """Draw the flakes: most of them far and small, a few near and out of focus."""
    layer = np.zeros(shape[:2], np.uint8)
    falling = _fall(weather, shape, 1500)
    slant = math.radians(weather.slant_deg)
    down = np.array([math.sin(slant), math.cos(slant)]) * shape[0] * 0.004
    for low, high, light, size in (
        (0.9, 1.0, 60, 0.009),
        (0.6, 0.9, 90, 0.004),
        (0.0, 0.6, 110, 0),
    ):
        chosen = falling[(falling[:, 2] >= low) & (falling[:, 2] < high)]
        _lines(layer, chosen[:, :2], down, light, max(1, round(size * shape[0])))
    return np.asarray(cv2.blur(layer, (3, 3)), np.uint8)


def _put_drops(weather: Weather, image: Image) -> Image:
    """Put drops on the lens: a drop is a wide lens of its own that shows the scene inverted."""
    height, width = image.shape[:2]
    result = image.copy()
    far = (max(1, width // _FAR), max(1, height // _FAR))
    whole = image[: far[1] * _FAR, : far[0] * _FAR]
    small = np.asarray(cv2.resize(whole, far, interpolation=cv2.INTER_AREA), np.uint8)
    drops = np.stack([_uniform(seed, (_DROPS_A_GROUP, 3)) for seed in weather.seeds], axis=1)
    for across, down, size in drops.reshape(-1, 3)[: weather.count]:
        radius = max(1, round((0.01 + 0.03 * size) * height))
        x, y = int(across * width), int(down * height)
        top, left = max(0, radius - y), max(0, radius - x)
        spot = result[y - radius + top : y + radius, x - radius + left : x + radius]
        cut = np.s_[top : top + spot.shape[0], left : left + spot.shape[1]]
        shown, mask = _seen_in_drop(small, across, down, radius)[cut], _disc(radius)[cut]
        spot[...] = cv2.blendLinear(shown, spot, mask, 1 - mask)
    return result


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
    """Return (2 radius, 2 radius): 1 inside, falling to 0 over the outer quarter."""
    offset = (np.arange(2 * radius, dtype=np.float32) + 0.5 - radius) / radius
    distance = np.hypot(offset[:, None], offset[None, :])
    return np.asarray(np.clip((1 - distance) * 4, 0, 1), np.float32)


def _dirt(weather: Weather, shape: tuple[int, ...]) -> Bytes:
    """Return the lens's transmission × 255: the part that the level covers lets 10 % through.

    The pattern's values are ranks, so that the level is the covered share; blots only grow.
    """
    N = weather.level / 100
    rough = sum(
        cv2.resize(_uniform(weather.seeds[0] + k, (cells, 2 * cells)).astype(np.float32), (128, 64),
                   interpolation=cv2.INTER_CUBIC) * weight
        for k, (cells, weight) in enumerate(((4, 1.0), (12, 0.5), (24, 0.25)))
    )  # fmt: skip
    ranks = np.argsort(np.argsort(np.ravel(rough), kind="stable")).reshape(64, 128) / (64 * 128)
    covered = np.clip((_COVERED * N - ranks) / 0.08, 0, 1)
    through = np.rint(255 * (1 - 0.9 * covered)).astype(np.uint8)
    smooth = cv2.resize(through, shape[1::-1], interpolation=cv2.INTER_LINEAR_EXACT)
    return np.asarray(smooth, np.uint8)
