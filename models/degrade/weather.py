"""Weather in front of the camera and on its lens. N = level / 100.

=====  ====================================  ===========================================
kind   what it does                          100 %
=====  ====================================  ===========================================
fog    Koschmieder's law, drifting banks     meteorological visibility of 50 m
rain   streaks, and the haze of the rain     100 mm/h: extinction of 6.8 / km, 1,200
                                             streaks an image
snow   flakes, and their haze                visibility of 150 m, 1,500 flakes an image
drops  drops on the lens: each shows the     64 drops of 1.5 to 5 % of the image's height
       scene small and upside down
dirt   blots on the lens, out of focus       three fifths of the lens covered
=====  ====================================  ===========================================

Without a depth map the scene is a street: depth grows toward the horizon from below and from
above. What glows in the air is the scene's own light, so that fog is grey by day and dark at
night. Drops and dirt stay on the lens from frame to frame; banks of fog drift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from models.degrade.camera import Image, check_image
from models.degrade.checks import check_level, check_within
from models.degrade.draw import DrawKey
from models.degrade.pointwise import Bytes, veil

KINDS = ("fog", "rain", "snow", "drops", "dirt")

CONTRAST_LIMIT = 3.912
"""-ln 0.02: extinction × visibility by Koschmieder."""

FARTHEST_M = 250.0
"""Depth in a depth map where it says nothing, as in the sky."""

HORIZON = 0.45
"""Where the horizon is taken to be, as a share of the image's height from its top."""

_CAMERA_HEIGHT_M = 1.5
_CANOPY_M = 25.0
_AHEAD_M = 80.0
_FOCAL_OF_WIDTH = 0.8
_COARSE = 4
_FAR = 8
_DROP_GROUPS = 8
_DROPS_A_GROUP = 8
_DROP_LIFE = 160
_COVERED = 0.6
_LIGHT_CELL = 16
_DAYLIGHT = 200.0
_DIRT_LIGHT = 0.25
_DIRT_EDGE = 0.35
_DIRT_OPACITY = 0.8


@dataclass(frozen=True, slots=True)
class Haze:
    """Airlight in front of the scene.

    Attributes
    ----------
    extinction:
        1/m.
    airlight:
        Of the scene's own light, see ``scene_light``.
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
    horizon:
        Share of the image's height above the horizon.
    """

    kind: str
    level: float
    haze: Haze | None
    count: int
    slant_deg: float
    seeds: tuple[int, ...]
    horizon: float = HORIZON


def draw(kind: str, level: float, key: DrawKey, *, horizon: float = HORIZON) -> Weather:
    """Draw the parameters of one kind of weather in one image.

    Parameters
    ----------
    kind:
        One of ``KINDS``.
    level:
        0 to 100 %; 0 is the identity.
    key:
        What the draw depends on.
    horizon:
        Share of the image's height above the horizon, 0 to 1: how the camera is mounted.

    Raises
    ------
    InputError
        If an argument is not one of these.
    """
    check_level(kind, level, KINDS)
    check_within("horizon", horizon, 0.0, 1.0, "of the image's height")
    N = level / 100
    lasting = DrawKey(key.seed, key.sensor, 0).generator(f"weather {kind}")
    airlight, slant = lasting.uniform(0.9, 1.0), lasting.uniform(-15, 15)
    seed = _seed(key, f"weather {kind} now")
    lasting_seed = int(lasting.bit_generator.random_raw())
    match kind:
        case "fog":
            extinction = N * CONTRAST_LIMIT / 50.0
            haze = Haze(extinction, airlight, 0.3, key.sequence * 0.02, lasting_seed)
            return Weather(kind, level, haze, 0, 0.0, (), horizon)
        case "rain":
            extinction = 0.312e-3 * (100.0 * N) ** 0.67
            haze = Haze(extinction, airlight)
            return Weather(kind, level, haze, round(1200 * N), slant, (seed,), horizon)
        case "snow":
            haze = Haze(N * CONTRAST_LIMIT / 150.0, airlight)
            return Weather(kind, level, haze, round(1500 * N), slant, (seed,), horizon)
        case "drops":
            count = round(_DROP_GROUPS * _DROPS_A_GROUP * N)
            return Weather(kind, level, None, count, 0.0, _drop_seeds(key), horizon)
        case _:
            return Weather(kind, level, None, 0, 0.0, (lasting_seed,), horizon)


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
    if weather.kind == "drops":
        return _put_drops(weather, image)
    light = scene_light(image, weather.horizon)
    if weather.haze is None:
        return veil(image, _dirt(weather, image.shape), _DIRT_LIGHT * light)
    through = _transmission(weather.haze, weather.horizon, image.shape, depth_m)
    result = veil(image, through, weather.haze.airlight * light)
    if weather.kind == "fog":
        return result
    fall = _streaks if weather.kind == "rain" else _flakes
    layer = cv2.convertScaleAbs(fall(weather, image.shape), alpha=light / _DAYLIGHT)
    return np.asarray(cv2.add(result, cv2.cvtColor(layer, cv2.COLOR_GRAY2BGR), dst=result))


def scene_light(image: Image, horizon: float = HORIZON) -> float:
    """Return how bright the air of the scene is, counts.

    The air is seen where the darkest colour channel is brightest (He, Sun, Tang, "Single image
    haze removal using dark channel prior", CVPR 2009). This is the median brightness of that fifth
    of the cells of 16 × 16 pixels above the horizon: a lamp at night fills few of them.
    """
    height, width = image.shape[:2]
    above = image[: max(1, round(horizon * height))]
    across, down = max(1, width // _LIGHT_CELL), max(1, len(above) // _LIGHT_CELL)
    sparse = cv2.resize(above, (4 * across, 4 * down), interpolation=cv2.INTER_NEAREST)
    cells = cv2.resize(sparse, (across, down), interpolation=cv2.INTER_AREA)
    brightest = np.argsort(cells.min(axis=2), axis=None)[-math.ceil(across * down / 5) :]
    light = np.sort(cells.reshape(-1, 3)[brightest].mean(axis=1))
    return float(light[len(light) // 2])


def default_depth(height: int, horizon: float = HORIZON) -> NDArray[np.float64]:
    """Return (height,) depth by row, m, of a street, for square pixels and an image of 16:9.

    A flat road 1.5 m below the camera, a canopy of trees and houses 25 m above it, and at the
    horizon what stands 80 m ahead: 1 / depth is the root of the sum of their squares.
    """
    focal = _FOCAL_OF_WIDTH * height * 16 / 9
    below = np.arange(height) + 0.5 - horizon * height
    away = np.where(below > 0, _CAMERA_HEIGHT_M, _CANOPY_M) * focal
    return np.asarray(1 / np.hypot(1 / _AHEAD_M, below / away))


def _transmission(
    haze: Haze, horizon: float, shape: tuple[int, ...], depth_m: NDArray[np.float32] | None
) -> Bytes:
    """Return exp(-extinction × depth) × 255, (height, width) uint8.

    Of banks of fog a picture of a quarter the size is enough, but for a depth map.
    """
    height, width = shape[:2]
    if depth_m is None:
        rows = -(-height // _COARSE) if haze.patchiness else height
        depth = default_depth(rows, horizon)[:, None]
    else:
        usable = np.isfinite(depth_m) & (depth_m > 0)
        depth = np.minimum(np.where(usable, depth_m, FARTHEST_M), FARTHEST_M).astype(np.float64)
    exponent = -haze.extinction * depth
    if haze.patchiness:
        columns = -(-width // _COARSE) if depth_m is None else width
        exponent = exponent * (1 + haze.patchiness * _banks_of_fog(haze, len(depth), columns))
    through = np.rint(np.exp(exponent) * 255).astype(np.uint8)
    whole = cv2.resize(through, (width, height), interpolation=cv2.INTER_LINEAR_EXACT)
    return np.asarray(whole, np.uint8)


def _banks_of_fog(haze: Haze, height: int, width: int) -> NDArray[np.float64]:
    """Return a smooth pattern within [-1, 1] that drifts sideways and never jumps."""
    pattern = _uniform(haze.seed, (6, 64)) * 2 - 1
    place = (np.arange(12) + haze.drift) % 64
    left = place.astype(np.intp)
    part = (place - left)[None, :]
    cells = pattern[:, left] * (1 - part) + pattern[:, (left + 1) % 64] * part
    smooth = cv2.resize(cells.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(smooth, -1, 1), np.float64)


def _uniform(seed: int, shape: tuple[int, ...]) -> NDArray[np.float64]:
    raw = np.random.SFC64(seed).random_raw(math.prod(shape))
    return np.asarray((raw >> 11).reshape(shape) * 2.0**-53, np.float64)


def _fall(weather: Weather, shape: tuple[int, ...], most: int) -> NDArray[np.float64]:
    """Return (count, 3): x and y over the whole image, and a uniform number, of what falls."""
    share = _uniform(weather.seeds[0], (most, 3))[: weather.count]
    return share * (shape[1], shape[0], 1.0)


def _lines(layer: Bytes, start: NDArray[np.float64], way: NDArray[np.float64], light: int,
           thickness: int, line: int) -> None:  # fmt: skip
    ends = np.rint(np.stack([start, start + way], axis=1) * 16).astype(np.int32)
    cv2.polylines(layer, list(ends), False, light, thickness, line, 4)


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
        _lines(layer, chosen[:, :2], length * down, light, thickness, cv2.LINE_AA)
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
        _lines(layer, chosen[:, :2], down, light, max(1, round(size * shape[0])), cv2.LINE_8)
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
        radius = max(1, round((0.015 + 0.035 * size) * height))
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
    """Return (2 radius, 2 radius): 1 inside, falling to 0 over the outer half: out of focus."""
    offset = (np.arange(2 * radius, dtype=np.float32) + 0.5 - radius) / radius
    distance = np.hypot(offset[:, None], offset[None, :])
    return np.asarray(np.clip((1 - distance) * 2, 0, 1), np.float32)


def _dirt(weather: Weather, shape: tuple[int, ...]) -> Bytes:
    """Return the lens's transmission × 255: where the dirt lies thick it lets a fifth through."""
    N = weather.level / 100
    covered = np.clip((_COVERED * N - _dirt_ranks(weather.seeds[0])) / _DIRT_EDGE, 0, 1)
    through = np.rint(255 * (1 - _DIRT_OPACITY * covered)).astype(np.uint8)
    smooth = cv2.resize(through, shape[1::-1], interpolation=cv2.INTER_LINEAR_EXACT)
    return np.asarray(smooth, np.uint8)


@lru_cache(maxsize=16)
def _dirt_ranks(seed: int) -> NDArray[np.float64]:
    """Return a smooth pattern of which each value in [0, 1) is the share of values below it.

    So the level is the covered share, and blots only grow.
    """
    rough = sum(
        cv2.resize(_uniform(seed + k, (cells, 2 * cells)).astype(np.float32), (128, 64),
                   interpolation=cv2.INTER_CUBIC) * weight
        for k, (cells, weight) in enumerate(((4, 1.0), (12, 0.5), (24, 0.25)))
    )  # fmt: skip
    order = np.argsort(np.ravel(rough), kind="stable")
    ranks = np.empty(order.size)
    ranks[order] = np.arange(order.size) / order.size
    return ranks.reshape(64, 128)
