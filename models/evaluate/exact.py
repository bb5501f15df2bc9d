"""What a camera degradation would give in exact arithmetic: float64, neither rounded nor clipped.

Its optics, noise, lens and codec are written anew for this, the slow and plain way. What is drawn,
or belongs to the scene, is taken from the kinds themselves: random bytes, places of drops, the
layer of streaks or flakes, banks of fog, blots of dirt, the scene's light and the street's depth.
"""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from models.degrade import camera, haze, imager, lens, weather
from models.degrade.pointwise import normal_quantiles, strips, words
from models.evaluate.blocks import in_float64, quantisation_tables

Image = NDArray[np.uint8]
Exact = NDArray[np.float64]


def exact(drawn: Any, image: Image) -> Exact:
    """Return the exact result, (height, width, 3).

    Parameters
    ----------
    drawn:
        What a kind's ``draw`` returned, of the default method.
    image:
        (height, width, 3) uint8.

    Raises
    ------
    KeyError
        If the degradation is none of a camera's.
    """
    match drawn:
        case camera.Blur():
            return _blurred(drawn, image.astype(np.float64))
        case camera.Exposure():
            kernel = np.array([0.25, 0.5, 0.25])
            light = image.astype(np.float64)
            spread = cv2.sepFilter2D(light, -1, kernel, kernel, borderType=cv2.BORDER_REFLECT_101)
            return np.asarray(spread * drawn.gain)
        case camera.Noise():
            return image + drawn.std * _normal(drawn.seed, image.shape, 16)
        case imager.Motion():
            return _smeared(drawn, image.astype(np.float32))
        case imager.Gain(gain=gain):
            return np.asarray(image * gain)
        case imager.SignalNoise(gain=gain, shot=shot, read=read):
            std = np.sqrt(shot * image.astype(np.float64) + read**2)
            return np.asarray(gain * image + std * _normal(drawn.seed, image.shape, 4))
        case imager.Stuck():
            return _stuck(drawn, image)
        case imager.Codec():
            quality = [cv2.IMWRITE_JPEG_QUALITY, drawn.quality]
            _, stream = cv2.imencode(".jpg", image, quality)
            return in_float64(image, *quantisation_tables(np.asarray(stream, np.uint8)))
        case weather.Weather(kind="drops"):
            return _behind_drops(drawn, image.astype(np.float64))
        case weather.Weather():
            return _in_weather(drawn, image)
        case _:
            raise KeyError(drawn.kind)


def _normal(seed: int, shape: tuple[int, ...], tables: int) -> Exact:
    """Return the standard normal values that the random bytes of an image stand for."""
    values = np.empty(math.prod(shape))
    for part, random, table in strips(seed, values.size, tables):
        values[part] = normal_quantiles(tables)[table][random[0]]
    return values.reshape(shape)


def _stuck(stuck: imager.Stuck, image: Image) -> Exact:
    """Set pixels one by one, in Python's integers."""
    result = image.astype(np.float64)
    height, width = image.shape[:2]
    pixels = result.reshape(-1, 3)
    if stuck.kind == "salt_pepper":
        edge = round(stuck.pixel_share * 32768)
        fates = [fate for _, part in words(stuck.seed, len(pixels)) for fate in part[0].tolist()]
        for place, fate in enumerate(fates):
            if not edge <= fate < 65536 - edge:
                pixels[place] = 0 if fate < edge else 255
        return result
    generator = np.random.SFC64(stuck.seed)
    ranked = [(generator.random_raw(), row) for row in range(height)]
    drawn = [generator.random_raw() for _ in range(round(stuck.pixel_share * height * width))]
    for number in drawn:
        pixels[number % (height * width)] = 255 * (number >> 63)
    for _, row in sorted(ranked)[: round(stuck.row_share * height)]:
        result[row] = 255 * (row % 2)
    return result


def _in_weather(drawn: weather.Weather, image: Image) -> Exact:
    light = haze.scene_light(image, drawn.horizon)
    height, width = image.shape[:2]
    if drawn.haze is None:
        coarse = lens.through_dirt(drawn.seeds[0], drawn.level)
        whole = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)
        through, glow = whole[..., None], weather.DIRT_LIGHT * light
    else:
        depth = haze.default_depth(height, drawn.horizon)[:, None]
        patches = drawn.haze.patchiness * haze.banks_of_fog(drawn.haze, height, width)
        through = np.exp(-drawn.haze.extinction * depth * (1 + patches))[..., None]
        glow = drawn.haze.airlight * light
    veiled = image * through + glow * (1 - through)
    if drawn.kind not in ("rain", "snow"):
        return np.asarray(veiled)
    layer = weather.falling(drawn, image.shape)[..., None]
    return np.asarray(np.minimum(veiled, 255) + layer * light / weather.DAYLIGHT)


def _behind_drops(drawn: weather.Weather, light: Exact) -> Exact:
    """Show a third of the scene upside down in each drop, pixel by pixel."""
    height, width = light.shape[:2]
    cell = 8
    across, down = max(1, width // cell), max(1, height // cell)
    whole = light[: down * cell, : across * cell]
    small = cv2.resize(whole, (across, down), interpolation=cv2.INTER_AREA)
    small = small.reshape(down, across, 3)
    result = light.copy()
    for right, below, size in lens.drops_of(drawn.seeds)[: drawn.count].tolist():
        radius, half = lens.radius_of(size, height), max(1, down // 3)
        x, y = int(right * across), int(below * down)
        scene = small[max(0, y - half) : y + half, max(0, x - half) : x + half]
        seen = cv2.resize(scene, (2 * radius, 2 * radius), interpolation=cv2.INTER_LINEAR)
        seen = seen.reshape(2 * radius, 2 * radius, 3)[::-1, ::-1]
        for row, column in product(range(2 * radius), repeat=2):
            to = int(below * height) - radius + row, int(right * width) - radius + column
            if 0 <= to[0] < height and 0 <= to[1] < width:
                away = math.hypot(row + 0.5 - radius, column + 0.5 - radius) / radius
                share = min(1.0, max(0.0, 2 * (1 - away)))
                result[to] += share * (seen[row, column] - result[to])
    return result


def _blurred(blur: camera.Blur, light: Exact) -> Exact:
    if blur.sigma == 0:
        return light
    size = (blur.size, blur.size)
    blurred = cv2.GaussianBlur(light, size, blur.sigma, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(blurred)


def _smeared(motion: imager.Motion, light: NDArray[np.float32]) -> Exact:
    """Return the mean of 256 bilinear samples along the smear."""
    angle = np.radians(motion.direction_deg)
    total = np.zeros(light.shape)
    for share in (np.arange(256) + 0.5) / 256 - 0.5:
        x, y = share * motion.length * np.cos(angle), share * motion.length * np.sin(angle)
        shift = np.array([[1, 0, x], [0, 1, y]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        total += cv2.warpAffine(
            light, shift, light.shape[1::-1], flags=flags, borderMode=cv2.BORDER_REFLECT
        )
    return total / 256
