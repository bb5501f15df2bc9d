"""The ground: road, pavement, grass, markings, with texture in perspective."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from models.world.objects import Floats
from models.world.render.textures import Image, asphalt, grass, stains
from models.world.render.view import Strip, View
from models.world.route import LANE, Land, Route
from models.world.scenery import PARKING, PAVEMENT

_SHIFT = 4
_BANDS = 1.45
_FINE = 10.24
_COARSE = (256.0, 32.0)

GRASS, CONCRETE, ASPHALT, PAINT = (52, 92, 84), (138, 140, 142), (104, 104, 102), (215, 218, 220)


@dataclass(frozen=True, slots=True, eq=False)
class GroundTextures:
    """Factor textures: fine ones of ``_FINE`` m square, a coarse one of ``_COARSE`` m."""

    asphalt: Image
    grass: Image
    stains: Image


def ground_textures(rng: np.random.Generator) -> GroundTextures:
    """Return the textures of one world."""
    return GroundTextures(asphalt(rng), grass(rng), stains(rng, 1024, 256))


def paint_ground(
    image: Image, view: View, strip: Strip, route: Route, textures: GroundTextures
) -> None:
    """Paint everything below the horizon into ``image``."""
    if len(strip.row) < 2:
        return
    top = int(strip.row[0])
    image[top:] = GRASS
    paved = np.zeros(image.shape[:2], np.uint8)
    _zones(image, paved, view, strip, route)
    _markings(image, view, strip, route)
    _texture(image, paved, view, strip, textures)


def _fill(
    image: Image, view: View, strip: Strip, left: Floats, right: Floats, colour: tuple[int, ...]
) -> None:
    """Fill between two lateral offsets, (m,) each."""
    limit = 4.0 * view.width
    a = np.clip(strip.column(view, left), -limit, limit)
    b = np.clip(strip.column(view, right), -limit, limit)
    outline = np.concatenate([np.stack([a, strip.row], 1), np.stack([b, strip.row], 1)[::-1]])
    points = np.rint(outline * 2**_SHIFT).astype(np.int32)
    cv2.fillPoly(image, [points], colour, cv2.LINE_AA, _SHIFT)


def _zones(image: Image, paved: Image, view: View, strip: Strip, route: Route) -> None:
    """Paint pavement, parking strips and carriageway; mark in ``paved`` what is paved."""
    land = route.land[route.index(strip.s)]
    outer = route.lookup(route.outer, strip.s)
    town = land == Land.CITY
    beyond = np.where(town, PARKING + PAVEMENT, 1.2)
    for canvas, colour in ((image, CONCRETE), (paved, (255,))):
        _fill(canvas, view, strip, outer + beyond, -outer - beyond, colour)
    shoulder = np.where(town, PARKING, 0.9)
    _fill(image, view, strip, outer + shoulder, -outer - shoulder, ASPHALT)


def _markings(image: Image, view: View, strip: Strip, route: Route) -> None:
    """Paint edge lines, centre line and lane lines, dashed where they are."""
    inner = route.lookup(route.inner, strip.s)
    outer = route.lookup(route.outer, strip.s)
    half = 0.07
    for d in (outer, -outer, inner, -inner):
        _fill(image, view, strip, d + half, d - half, PAINT)
    first = np.floor(strip.s.min() / 12) * 12
    for start in np.arange(first, min(strip.s.max(), view.s + 120), 12.0):
        _dash(image, view, strip, route, start, start + 4.0, half)


def _dash(
    image: Image, view: View, strip: Strip, route: Route, start: float, end: float, half: float
) -> None:
    """Paint one dash of the lane lines where there are two lanes."""
    s = np.array([start, end, end, start])
    inner = route.lookup(route.inner, s)
    if np.any(route.lookup(route.outer, s) - inner < 1.8 * LANE):
        return
    for side in (-1.0, 1.0):
        d = side * (inner + LANE) + half * np.array([1, 1, -1, -1])
        x, y, _ = route.place(s, d)
        ahead, left = view.to_camera(x, y)
        if ahead.min() > 1.0:
            u, v = view.project(ahead, left, np.zeros(4))
            points = np.rint(np.stack([u, v], 1) * 2**_SHIFT).astype(np.int32)
            cv2.fillConvexPoly(image, points, PAINT, cv2.LINE_AA, _SHIFT)


def _texture(
    image: Image, paved: Image, view: View, strip: Strip, textures: GroundTextures
) -> None:
    """Multiply the ground with its textures, each averaged over what a pixel covers."""
    column = np.arange(view.width, dtype=np.float32)
    start = 0
    while start < len(strip.row):
        limit = strip.ahead[start] / _BANDS
        end = start + max(int(np.searchsorted(-strip.ahead[start:], -limit)), 1)
        band = slice(start, end)
        ahead = float(strip.ahead[band].mean())
        across, along = ahead / view.focal, ahead**2 / (view.focal * view.above)
        d = (
            (view.width / 2 - column) * (strip.ahead[band] / view.focal)[:, None]
            - strip.centre[band, None]
        ) * strip.slope[band, None]
        s = np.broadcast_to(strip.s[band, None], d.shape)
        rows = slice(int(strip.row[start]), int(strip.row[start]) + end - start)
        road = _sample(textures.asphalt, (_FINE, _FINE), s, d, along, across)
        field = _sample(textures.grass, (_FINE, _FINE), s, d, along, across)
        cv2.copyTo(road, paved[rows], field)
        coarse = _sample(textures.stains, _COARSE, s, d, along, across)
        factor = cv2.multiply(field, coarse, scale=1 / 128)
        image[rows] = cv2.multiply(image[rows], cv2.merge([factor] * 3), scale=1 / 128)
        start = end


def _sample(
    texture: Image, size: tuple[float, float], s: Floats, d: Floats, along: float, across: float
) -> Image:
    """Return a texture of ``size`` m (along, across) at road positions, averaged over pixels."""
    height = int(np.clip(size[0] / along, 1, texture.shape[0]))
    width = int(np.clip(size[1] / across, 1, texture.shape[1]))
    small = cv2.resize(texture, (width, height), interpolation=cv2.INTER_AREA)
    x = np.mod(d * (width / size[1]), width).astype(np.float32)
    y = np.mod(s * (height / size[0]), height).astype(np.float32)
    return np.asarray(
        cv2.remap(small, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.uint8
    )
