"""The ground: road, pavement, grass, markings and shadows, with texture in perspective."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from models.world.objects import VEHICLES, Floats, Kind, Objects
from models.world.render.canvas import NEAREST, Canvas, clip_near, fill, fill_any
from models.world.render.textures import Image, asphalt, grass, stains
from models.world.render.view import Strip
from models.world.route import LANE, Land, Route
from models.world.scenery import PARKING, PAVEMENT, SIDE_STREET

INSIDE = 0.40
"""Factor on coded radiance inside a tunnel."""

_SHIFT = 4
_BAND = 1.45
_FINE_M, _COARSE_M = (10.24, 10.24), (256.0, 32.0)
_MARKED_M = 120.0
_EDGE = 0.07

_GRASS, _PAVEMENT, _ASPHALT = (62, 108, 98), (156, 159, 162), (126, 126, 124)
_PARKING_STRIP, _PAINT = (118, 118, 117), (208, 212, 214)
_KERB = (168, 170, 172)
_SHADE = 0.56
_GANTRY, _TREE = int(Kind.GANTRY), int(Kind.TREE)
_VEHICLE = np.isin(np.arange(len(Kind)), VEHICLES)
_LARGE = _VEHICLE | np.isin(np.arange(len(Kind)), (Kind.BUILDING, Kind.TREE))


Singles = NDArray[np.float32]


class GroundTextures:
    """Factor textures of one world, each at every size that was asked for."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._full = {
            "asphalt": asphalt(rng), "grass": grass(rng), "stains": stains(rng, 1024, 256)
        }  # fmt: skip
        self._small: dict[tuple[str, int, int], Image] = {}

    def sized(self, name: str, height: float, width: float) -> Image:
        """Return a texture averaged down to about ``height`` x ``width`` pixels.

        The first row and column come again at the end, so that it can be tiled.
        """
        full = self._full[name]
        size = tuple(
            int(np.clip(2 ** (np.rint(2 * np.log2(max(wanted, 1.0))) / 2), 1, most))
            for wanted, most in zip((height, width), full.shape, strict=True)
        )
        key = (name, size[0], size[1])
        if key not in self._small:
            small = cv2.resize(full, size[::-1], interpolation=cv2.INTER_AREA)
            self._small[key] = np.pad(small.astype(np.uint8), ((0, 1), (0, 1)), mode="wrap")
        return self._small[key]


def paint_ground(
    canvas: Canvas, strip: Strip, route: Route, textures: GroundTextures, objects: Objects
) -> None:
    """Paint everything below the horizon."""
    if len(strip.row) < 2:
        return
    top = int(strip.row[0])
    corner = (canvas.view.width, canvas.view.height)
    cv2.rectangle(canvas.image, (0, max(int(canvas.view.horizon), 0)), corner, _GRASS, cv2.FILLED)
    paved = np.zeros(canvas.image.shape[:2], np.uint8)
    _zones(canvas, paved, strip, route)
    _side_streets(canvas, paved, strip, route)
    _markings(canvas, strip, route)
    _texture(canvas, paved, strip, textures)
    _shadows(canvas, objects)
    _tunnel(canvas, strip, route)
    _haze(canvas, strip, top)


def _fill_along(
    image: Image, canvas: Canvas, strip: Strip, left: Floats, right: Floats, colour: tuple[int, ...]
) -> None:
    """Fill between two lateral offsets, one of each a row."""
    limit = 4.0 * canvas.view.width
    a = np.clip(strip.column(canvas.view, left), -limit, limit)
    b = np.clip(strip.column(canvas.view, right), -limit, limit)
    columns, rows = np.concatenate([a, b[::-1]]), np.concatenate([strip.row, strip.row[::-1]])
    fill_any(image, np.stack([columns, rows], axis=1), colour)


def _zones(canvas: Canvas, paved: Image, strip: Strip, route: Route) -> None:
    """Paint pavement, parking strips and carriageway; mark in ``paved`` what is paved."""
    town = route.land[route.index(strip.s)] == Land.CITY
    outer = route.lookup(route.outer, strip.s)
    beyond = outer + np.where(town, PARKING + PAVEMENT, 1.4)
    kerb = outer + np.where(town, PARKING, 1.0)
    for image, colour in ((canvas.image, _PAVEMENT), (paved, (255,))):
        _fill_along(image, canvas, strip, beyond, -beyond, colour)
    _fill_along(canvas.image, canvas, strip, kerb, -kerb, _PARKING_STRIP)
    _fill_along(canvas.image, canvas, strip, outer, -outer, _ASPHALT)
    edge = np.where(town, 0.16, 0.0)
    for side in (1.0, -1.0):
        _fill_along(canvas.image, canvas, strip, side * (kerb + edge), side * kerb, _KERB)


def _on_ground(canvas: Canvas, route: Route, s: Floats, d: Floats) -> Floats:
    """Return the pixels, (n, 2), of a polygon on the road; none where it is out of sight."""
    x, y, _ = route.place(s, d)
    ahead, left = canvas.view.to_camera(x, y)
    if ahead.max() < 1.0:
        return np.empty((0, 2))
    points = clip_near(np.stack([ahead, left, np.zeros(len(ahead))], axis=1))
    return canvas.view.pixels(points)


def _side_streets(canvas: Canvas, paved: Image, strip: Strip, route: Route) -> None:
    """Paint side streets, stop lines and crosswalks at the junctions ahead."""
    near = np.abs(route.junctions - canvas.view.s - 70) < 80
    for junction in route.junctions[near]:
        outer = float(route.lookup(route.outer, np.asarray(junction)))
        for side in (1.0, -1.0):
            s = junction + (SIDE_STREET - 1) * np.array([-1.0, -1.0, 1.0, 1.0])
            d = side * (outer + np.array([-0.5, 60.0, 60.0, -0.5]))
            where = _on_ground(canvas, route, s, d)
            if len(where):
                fill(canvas.image, where, _ASPHALT)
                fill(paved, where, (255,))
        if canvas.view.s - 10 < junction < canvas.view.s + _MARKED_M:
            _crosswalk(canvas, route, float(junction), outer)


def _crosswalk(canvas: Canvas, route: Route, junction: float, outer: float) -> None:
    """Paint the bars of a crosswalk and the stop line before it."""
    for place in (junction - SIDE_STREET - 1.5, junction + SIDE_STREET + 1.5):
        for d in np.arange(-outer + 0.4, outer - 0.4, 1.0):
            s = place + np.array([-1.4, 1.4, 1.4, -1.4])
            where = _on_ground(canvas, route, s, d + np.array([0.0, 0.0, 0.5, 0.5]))
            if len(where):
                fill(canvas.image, where, _PAINT)
    s = junction - SIDE_STREET - 4.0 + np.array([-0.2, 0.2, 0.2, -0.2])
    where = _on_ground(canvas, route, s, np.array([0.0, 0.0, -outer, -outer]))
    if len(where):
        fill(canvas.image, where, _PAINT)


def _markings(canvas: Canvas, strip: Strip, route: Route) -> None:
    """Paint edge lines, centre line and the dashes between lanes, away from junctions."""
    inner, outer = route.lookup(route.inner, strip.s), route.lookup(route.outer, strip.s)
    gap = np.zeros(len(strip.s), bool)
    if len(route.junctions):
        gap = np.abs(strip.s[:, None] - route.junctions).min(axis=1) < SIDE_STREET + 4
    double = np.maximum(inner, 0.12)
    for d in (outer - 0.1, 0.1 - outer, double, -double):
        for run in _runs(~gap):
            part = strip.part(run)
            _fill_along(canvas.image, canvas, part, d[run] + _EDGE, d[run] - _EDGE, _PAINT)
    first = np.floor(strip.s.min() / 12) * 12
    for start in np.arange(first, min(strip.s.max(), canvas.view.s + _MARKED_M), 12.0):
        s = start + np.array([0.0, 4.0, 4.0, 0.0])
        inside = route.lookup(route.inner, s)
        if np.any(route.lookup(route.outer, s) - inside < 1.8 * LANE):
            continue
        for side in (-1.0, 1.0):
            d = side * (inside + LANE) + _EDGE * np.array([1.0, 1.0, -1.0, -1.0])
            where = _on_ground(canvas, route, s, d)
            if len(where):
                fill(canvas.image, where, _PAINT)


def _runs(chosen: NDArray[np.bool_]) -> list[slice]:
    """Return the runs of at least two entries that are chosen."""
    edges = np.flatnonzero(np.diff(chosen, prepend=False, append=False))
    return [slice(a, b) for a, b in edges.reshape(-1, 2).tolist() if b - a > 1]


def _texture(canvas: Canvas, paved: Image, strip: Strip, textures: GroundTextures) -> None:
    """Multiply the ground with its textures, each averaged over what a pixel covers."""
    view = canvas.view
    column = ((view.width / 2 - np.arange(view.width)) / view.focal).astype(np.float32)
    start = 0
    while start < len(strip.row):
        limit = strip.ahead[start] / _BAND
        end = start + max(int(np.searchsorted(-strip.ahead[start:], -limit)), 1)
        ahead, centre, slope, s = (
            table[start:end, None].astype(np.float32)
            for table in (strip.ahead, strip.centre, strip.slope, strip.s)
        )
        d = (column * ahead - centre) * slope
        middle = float(ahead.mean())
        pixel = middle**2 / (view.focal * view.above), middle / view.focal
        rows = slice(int(strip.row[start]), int(strip.row[start]) + end - start)
        field = _surface(textures, paved[rows], s, d, pixel)
        coarse = _sample(textures, "stains", _COARSE_M, s, d, pixel)
        factor = cv2.multiply(field, coarse, scale=1 / 128)
        part = canvas.image[rows]
        cv2.multiply(part, cv2.merge([factor, factor, factor]), dst=part, scale=1 / 128)
        start = end


def _surface(
    textures: GroundTextures, paved: Image, s: Singles, d: Singles, pixel: tuple[float, float]
) -> Image:
    """Return asphalt where it is paved, grass elsewhere."""
    share = cv2.countNonZero(paved)
    if share == paved.size:
        return _sample(textures, "asphalt", _FINE_M, s, d, pixel)
    field = _sample(textures, "grass", _FINE_M, s, d, pixel)
    if share:
        cv2.copyTo(_sample(textures, "asphalt", _FINE_M, s, d, pixel), paved, field)
    return field


def _sample(
    textures: GroundTextures,
    name: str,
    size: tuple[float, float],
    s: Singles,
    d: Singles,
    pixel: tuple[float, float],
) -> Image:
    """Return a texture of ``size`` m (along, across) at road positions (rows, columns)."""
    small = textures.sized(name, size[0] / pixel[0], size[1] / pixel[1])
    height, width = small.shape[0] - 1, small.shape[1] - 1
    x = d * np.float32(1 / size[1])
    x -= np.floor(x)
    x *= np.float32(width)
    y = np.mod(s, np.float32(size[0])) * np.float32(height / size[0])
    y = np.ascontiguousarray(np.broadcast_to(y, d.shape))
    return np.asarray(cv2.remap(small, x, y, cv2.INTER_LINEAR), np.uint8)


def _shadows(canvas: Canvas, objects: Objects) -> None:
    """Darken the ground where objects keep the sun off, and below vehicles in any light."""
    mask: Image = np.zeros(canvas.image.shape[:2], np.uint8)
    ahead, _ = canvas.view.to_camera(objects.x, objects.y)
    near = (ahead > -30) & (ahead < np.where(_LARGE[objects.kind], 110, 45))
    chosen = objects[near & (objects.kind != _GANTRY)]
    corners = chosen.corners()
    sx, sy, sz = canvas.light.sun
    if canvas.light.direct > 0.3:
        reach = chosen.height[:, None, None] * np.array([-sx, -sy]) / sz
        cast = np.concatenate([corners, corners + reach], axis=1)
        _darken(canvas, mask, cast, np.where(chosen.kind == _TREE, 150, 255))
    under = _VEHICLE[chosen.kind]
    _darken(canvas, mask, corners[under], np.full(int(under.sum()), 200))
    soft = cv2.blur(mask, (3, 3))
    factor = cv2.convertScaleAbs(soft, alpha=-(1 - _SHADE) * 128 / 255, beta=128)
    top = max(int(canvas.view.horizon), 0)
    ground = canvas.image[top:]
    cv2.multiply(ground, cv2.merge([factor[top:]] * 3), dst=ground, scale=1 / 128)


def _darken(canvas: Canvas, mask: Image, corners: Floats, strength: NDArray[np.int_]) -> None:
    """Fill in the mask the hulls of N groups of corners on the ground, (N, n, 2) in the world."""
    ahead, left = canvas.view.to_camera(corners[..., 0], corners[..., 1])
    ahead = np.maximum(ahead, NEAREST)
    points = np.stack([ahead, left, np.zeros(ahead.shape)], axis=-1)
    pixels = canvas.view.pixels(points)
    visible = (pixels[..., 0].max(axis=1) > 0) & (pixels[..., 0].min(axis=1) < canvas.view.width)
    visible &= ahead.max(axis=1) > NEAREST
    for i in np.flatnonzero(visible):
        hull = cv2.convexHull(pixels[i].astype(np.float32))[:, 0]
        fill(mask, hull, (int(strength[i]),))


def _tunnel(canvas: Canvas, strip: Strip, route: Route) -> None:
    """Darken the ground inside tunnels."""
    top = int(strip.row[0])
    for run in _runs(route.tunnel[route.index(strip.s)]):
        rows = canvas.image[top + run.start : top + run.stop]
        cv2.convertScaleAbs(rows, dst=rows, alpha=INSIDE)


def _haze(canvas: Canvas, strip: Strip, top: int) -> None:
    """Fade the far ground into the haze."""
    far = strip.ahead > 30
    share = (1 - np.exp(-strip.ahead[far] / canvas.light.haze_m))[:, None, None]
    rows = canvas.image[top : top + len(share)]
    rows[:] = (rows * (1 - share) + np.asarray(canvas.light.horizon) * share).astype(np.uint8)
