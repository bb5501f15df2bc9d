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

Drops and dirt stay on the lens from frame to frame; banks of fog drift. What is drawn here is done
by ``models.degrade.haze``, ``precipitation`` and ``lens``.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from models.degrade.camera import Image, check_image
from models.degrade.checks import check_level, check_within
from models.degrade.draw import DrawKey
from models.degrade.haze import CONTRAST_LIMIT, HORIZON, Haze, scene_light, transmission
from models.degrade.lens import DROPS_A_GROUP, dirt, put_drops
from models.degrade.pointwise import Bytes, veil
from models.degrade.precipitation import MOST_FLAKES, MOST_STREAKS, flakes, streaks

KINDS = ("fog", "rain", "snow", "drops", "dirt")

_DROP_GROUPS = 8
_DROP_LIFE = 160

DAYLIGHT = 200.0
"""Light of a scene in which what falls is as bright as it is drawn, counts."""

DIRT_LIGHT = 0.25
"""Of the scene's light that dirt scatters into the camera."""


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
    kind, level, key:
        As for every kind: see ``models.degrade.kinds``.
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
            return Weather(kind, level, haze, round(MOST_STREAKS * N), slant, (seed,), horizon)
        case "snow":
            haze = Haze(N * CONTRAST_LIMIT / 150.0, airlight)
            return Weather(kind, level, haze, round(MOST_FLAKES * N), slant, (seed,), horizon)
        case "drops":
            count = round(_DROP_GROUPS * DROPS_A_GROUP * N)
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
        return put_drops(image, weather.seeds, weather.count)
    light = scene_light(image, weather.horizon)
    if weather.haze is None:
        through = dirt(weather.seeds[0], weather.level, image.shape)
        return veil(image, through, DIRT_LIGHT * light)
    through = transmission(weather.haze, weather.horizon, image.shape, depth_m)
    if weather.kind == "fog":
        return veil(image, through, weather.haze.airlight * light)
    layer = falling(weather, image.shape)
    cv2.convertScaleAbs(layer, dst=layer, alpha=light / DAYLIGHT)
    return veil(image, through, weather.haze.airlight * light, layer)


def falling(weather: Weather, shape: tuple[int, ...]) -> Bytes:
    """Return the layer of light of what falls by daylight, (height, width), of rain or snow."""
    make = streaks if weather.kind == "rain" else flakes
    return make(weather.seeds[0], weather.count, weather.slant_deg, shape)
