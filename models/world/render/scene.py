"""The whole picture: sky, ground, then objects from far to near."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.world.objects import VEHICLES, Kind, Objects
from models.world.render.canvas import NEAREST, Canvas
from models.world.render.facades import Facades, draw_facades, paint_facades
from models.world.render.furniture import paint_furniture
from models.world.render.ground import INSIDE, GroundTextures, paint_ground
from models.world.render.light import Light, draw_light
from models.world.render.plants import Plants, draw_plants, paint_plant
from models.world.render.sky import Panorama, paint_sky, panorama
from models.world.render.textures import Image
from models.world.render.vehicles import paint_vehicle
from models.world.render.view import View, strip
from models.world.road import World

_ROOF_M = 5.5
_ROOF_STEP = 6.0
_FARTHEST = 260.0


def _table(*kinds: Kind) -> NDArray[np.bool_]:
    """Return by kind whether it is one of these."""
    return np.isin(np.arange(len(Kind)), kinds)


_SMALL = _table(Kind.POST, Kind.BUSH, Kind.FENCE, Kind.RAIL, Kind.SIGN)
_VEHICLE = _table(*VEHICLES)
_WALLED = _table(Kind.BUILDING, Kind.WALL)
_PLANT = _table(Kind.TREE, Kind.BUSH)
_HOUSE = int(Kind.BUILDING)


class Scenery:
    """All that does not change during a drive: light, textures, sprites."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.light: Light = draw_light(rng)
        self.sky: Panorama = panorama(rng, self.light)
        self.ground = GroundTextures(rng)
        self.facades: Facades = draw_facades(rng)
        self.plants: Plants = draw_plants(rng)


def paint(world: World, scenery: Scenery, view: View, t_s: float) -> Image:
    """Return the canvas (height, width, 3) of the world at ``t_s`` seconds from the start."""
    canvas = Canvas(np.empty((view.height, view.width, 3), np.uint8), view, scenery.light)
    objects = world.objects(t_s)
    paint_sky(canvas.image, view, scenery.sky)
    paint_ground(canvas, strip(view, world.route), world.route, scenery.ground, objects)
    braking = world.ego(t_s + 1.0).speed < world.ego(t_s).speed - 0.4
    inside = world.route.tunnel[world.route.index(objects.s)]
    roofs = _roofs(world, view)
    order = _far_to_near(view, objects)
    distance = view.to_camera(objects.x, objects.y)[0]
    for i in order:
        while roofs and roofs[0][0] >= distance[i]:
            _paint_roof(canvas, world, *roofs.pop(0))
        dim = INSIDE if inside[i] else 1.0
        kind = objects.kind[i]
        if _VEHICLE[kind]:
            paint_vehicle(canvas, objects, i, braking, dim)
        elif _WALLED[kind]:
            paint_facades(canvas, scenery.facades, objects, i, dim)
        elif _PLANT[kind]:
            paint_plant(canvas, scenery.plants, objects, i)
        else:
            paint_furniture(canvas, objects, i, dim, t_s)
    for roof in roofs:
        _paint_roof(canvas, world, *roof)
    return canvas.image


def _far_to_near(view: View, objects: Objects) -> list[int]:
    """Return the objects in sight, the farthest first, without those behind nearer houses."""
    ahead, left = view.to_camera(objects.x, objects.y)
    size = np.maximum(objects.length, objects.width) / 2
    near = ahead + size > NEAREST
    slope = np.abs(left) - size < (ahead + size) * view.width / (2 * view.focal) + 1
    reach = np.where(_SMALL[objects.kind], 130.0, _FARTHEST)
    chosen = np.flatnonzero(near & slope & (ahead < reach))
    corners = objects[chosen].corners()
    depth, aside = view.to_camera(corners[..., 0], corners[..., 1])
    cut = np.maximum(depth, NEAREST)
    column = view.width / 2 - aside * view.focal / cut
    first = np.clip(np.floor(column.min(axis=1)), 0, view.width - 1).astype(int)
    last = np.clip(np.ceil(column.max(axis=1)), 1, view.width).astype(int)
    top = view.horizon + (view.above - objects.z[chosen] - objects.height[chosen]) * (
        view.focal / cut.max(axis=1)
    )
    nearest = np.argsort(ahead[chosen])
    skyline = np.full(view.width, np.inf)
    visible = []
    for k in nearest.tolist():
        columns = skyline[first[k] : last[k]]
        if len(columns) and np.all(columns <= np.minimum(top[k], view.horizon)):
            continue
        visible.append(int(chosen[k]))
        if objects.kind[chosen[k]] == _HOUSE and depth[k].min() > NEAREST:
            low = (
                view.horizon
                + (view.above - objects.height[chosen[k]]) * view.focal / depth[k].max()
            )
            np.minimum(columns, low, out=columns)
    return visible[::-1]


def _roofs(world: World, view: View) -> list[tuple[float, float]]:
    """Return distance and position of the pieces of tunnel roof ahead, the farthest first."""
    s = np.arange(np.floor(view.s / _ROOF_STEP) * _ROOF_STEP, view.s + _FARTHEST, _ROOF_STEP)
    s = s[world.route.tunnel[world.route.index(s)]]
    return [(float(place - view.s), float(place)) for place in s[::-1]]


def _paint_roof(canvas: Canvas, world: World, distance: float, s: float) -> None:
    """Paint a piece of a tunnel's roof with its lamps, and the portal where it begins."""
    route = world.route
    places = s + np.array([0.0, _ROOF_STEP, _ROOF_STEP, 0.0])
    outer = route.lookup(route.outer, places) + 2.0
    for width, up, colour in ((outer, _ROOF_M, 62.0), (np.full(4, 0.35), _ROOF_M - 0.05, 236.0)):
        x, y, _ = route.place(places, width * np.array([1.0, 1.0, -1.0, -1.0]))
        ahead, left = canvas.view.to_camera(x, y)
        canvas.face(np.stack([ahead, left, np.full(4, up)], axis=1), np.full(3, colour))
    if route.tunnel[route.index(np.asarray(s - _ROOF_STEP))] or distance < 1:
        return
    wide = float(outer[0])
    openings = ((wide, wide + 14, 0.0), (-wide - 14, -wide, 0.0), (-wide, wide, _ROOF_M))
    for one, other, low in openings:
        x, y, _ = route.place(np.full(4, s), np.array([one, other, other, one]))
        ahead, left = canvas.view.to_camera(x, y)
        portal = np.stack([ahead, left, np.array([low, low, 9.0, 9.0])], axis=1)
        canvas.face(portal, np.array([132.0, 136.0, 140.0]))
