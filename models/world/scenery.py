"""What stands beside the road: buildings, parked cars, poles, signs, trees, guard rails."""

from __future__ import annotations

import numpy as np

from models.world.objects import Floats, Kind, Objects, concatenate
from models.world.route import STEP, Land, Route

PARKING = 2.3
"""Width of the parking strip in towns, m."""

PAVEMENT = 3.0
"""Width of the pavement in towns, m."""

SIDE_STREET = 7.0
"""Half of the gap that a side street leaves between the buildings, m."""

_RAIL_PIECE = 4.0


def furnish(rng: np.random.Generator, route: Route, end: float) -> Objects:
    """Return everything that stands along the first ``end`` metres, sorted by position."""
    parts = [part for side in (-1.0, 1.0) for part in _side(rng, route, end, side)]
    parts += [_median(rng, route, end), *_lights(rng, route, end)]
    everything = concatenate(parts)
    everything = everything[_off_the_road(route, everything)]
    return everything[np.argsort(everything.s, kind="stable")]


def stand(
    rng: np.random.Generator,
    route: Route,
    kind: Kind,
    s: Floats,
    d: Floats,
    size: tuple[Floats | float, Floats | float, Floats | float],
    z: float = 0.0,
) -> Objects:
    """Return standing objects of one kind along the road's heading."""
    n = len(s)
    x, y, heading = route.place(s, d)
    length, width, height = (np.broadcast_to(np.asarray(value, float), n).copy() for value in size)
    return Objects(
        np.full(n, kind, np.uint8),
        s,
        x,
        y,
        np.full(n, z),
        heading,
        length,
        width,
        height,
        np.zeros(n),
        np.zeros(n),
        rng.integers(0, 2**32, n, np.uint32),
    )


def _side(rng: np.random.Generator, route: Route, end: float, side: float) -> list[Objects]:
    """Return what stands on one side (+1 left, -1 right)."""

    def put(
        kind: Kind,
        where: tuple[Land, ...],
        spacing: float,
        beyond: tuple[float, float],
        size: tuple[Floats | float, Floats | float, Floats | float] | None = None,
        clear: float = SIDE_STREET,
        jitter: float = 1.0,
    ) -> Objects:
        """Scatter one kind every ``spacing`` metres, ``beyond`` metres off the outer edge."""
        s = np.arange(0, end, spacing)
        s = s + rng.uniform(-jitter, jitter, len(s)) * spacing / 2
        d = route.lookup(route.outer, s) + rng.uniform(*beyond, len(s))
        shape = size or sizes(rng, kind, len(s))
        objects = stand(rng, route, kind, s, side * d, shape)
        keep = np.isin(route.land[route.index(s)], where) & ~route.tunnel[route.index(s)]
        if len(route.junctions):
            gap = np.abs(s[:, None] - route.junctions).min(axis=1) - objects.length / 2
            keep &= gap > clear
        return objects[keep]

    kerb = PARKING + PAVEMENT
    fullness = rng.uniform(0.4, 1.1)
    town, open_land = (Land.CITY,), (Land.COUNTRY, Land.MOTORWAY)
    parked = put(Kind.CAR, town, 6.5, (1.0, 1.3), clear=10.0, jitter=0.1)
    vans = put(Kind.VAN, town, 70.0, (1.1, 1.3), clear=10.0)
    return [
        parked[rng.random(len(parked)) < 0.5],
        vans,
        _buildings(rng, route, end, side),
        put(Kind.POLE, town, 30.0, (PARKING + 0.4, PARKING + 0.7), jitter=0.1),
        put(Kind.SIGN, town, 45.0, (PARKING + 0.4, PARKING + 0.9)),
        put(Kind.TREE, town, 25.0, (PARKING + 0.6, PARKING + 1.0)),
        put(Kind.POST, town, 10.0 / fullness, (PARKING + 0.3, kerb - 0.3)),
        put(Kind.BUSH, town, 6.0 / fullness, (kerb, kerb + 18.0)),
        put(Kind.CAR, town, 10.0 / fullness, (kerb + 6.0, kerb + 22.0)),
        put(Kind.POLE, town, 18.0 / fullness, (kerb + 1.0, kerb + 22.0)),
        _fences(rng, route, end, side),
        put(Kind.POST, (Land.COUNTRY,), 50.0, (1.2, 1.3), jitter=0.0),
        put(Kind.SIGN, open_land, 160.0, (2.0, 3.0)),
        put(Kind.POLE, (Land.COUNTRY,), 55.0, (5.0, 7.0), jitter=0.1),
        put(Kind.TREE, open_land, 11.0, (7.0, 45.0)),
        put(Kind.BUSH, open_land, 9.0, (4.0, 30.0)),
        put(Kind.GANTRY, (Land.MOTORWAY,), 900.0, (1.5, 1.5)),
        _rails(rng, route, end, side),
        _tunnel_walls(rng, route, end, side),
    ]


def sizes(rng: np.random.Generator, kind: Kind, n: int) -> tuple[Floats, Floats, Floats]:
    """Return random lengths, widths and heights of a kind, m."""
    low, high = {
        Kind.CAR: ((3.7, 1.65, 1.4), (4.8, 1.9, 1.75)),
        Kind.VAN: ((4.9, 1.9, 1.95), (6.2, 2.05, 2.7)),
        Kind.TRUCK: ((7.5, 2.4, 3.2), (16.0, 2.55, 4.0)),
        Kind.PEDESTRIAN: ((0.3, 0.45, 1.55), (0.45, 0.6, 1.9)),
        Kind.POLE: ((0.15, 0.15, 6.0), (0.22, 0.22, 9.0)),
        Kind.SIGN: ((0.08, 0.6, 2.4), (0.1, 0.9, 3.2)),
        Kind.TRAFFIC_LIGHT: ((0.25, 0.3, 3.2), (0.3, 0.35, 3.6)),
        Kind.TREE: ((3.0, 3.0, 5.0), (7.0, 7.0, 13.0)),
        Kind.BUSH: ((1.0, 1.0, 0.6), (3.0, 3.0, 2.2)),
        Kind.POST: ((0.12, 0.12, 0.9), (0.3, 0.3, 1.1)),
        Kind.GANTRY: ((0.4, 0.4, 6.5), (0.5, 0.5, 7.5)),
    }[kind]
    share = rng.random(n)
    spread = [share * (b - a) + a for a, b in zip(low, high, strict=True)]
    return spread[0], spread[1], spread[2]


def _buildings(rng: np.random.Generator, route: Route, end: float, side: float) -> Objects:
    """Return rows of houses in towns, with gaps, and none across a side street."""
    count = int(end / 12) + 2
    length = rng.uniform(8, 30, count)
    gap = np.where(rng.random(count) < 0.4, rng.uniform(1, 18, count), 0.3)
    s = np.cumsum(length + gap) - length / 2
    depth = rng.uniform(8, 16, count)
    setback = PARKING + PAVEMENT + np.where(rng.random(count) < 0.4, 0, rng.uniform(1, 30, count))
    d = route.lookup(route.outer, s) + setback + depth / 2
    height = rng.uniform(5, 22, count)
    objects = stand(rng, route, Kind.BUILDING, s, side * d, (length, depth, height))
    keep = (route.land[route.index(s)] == Land.CITY) & (s < end)
    if len(route.junctions):
        keep &= np.abs(s[:, None] - route.junctions).min(axis=1) - length / 2 > SIDE_STREET
    bends = route.lookup(np.abs(route.curvature), s)
    return objects[keep & (bends < 0.01)]


def _fences(rng: np.random.Generator, route: Route, end: float, side: float) -> Objects:
    """Return fences and low walls along the pavements of towns, by stretches."""
    s = np.arange(0, end, _RAIL_PIECE)
    stretch = (s / 30).astype(int)
    keep = rng.random(int(end / 30) + 2)[stretch] < 0.4
    keep &= route.land[route.index(s)] == Land.CITY
    if len(route.junctions):
        keep &= np.abs(s[:, None] - route.junctions).min(axis=1) > SIDE_STREET + 2
    away = rng.uniform(0.2, 5.0, int(end / 30) + 2)[stretch[keep]]
    d = route.lookup(route.outer, s[keep]) + PARKING + PAVEMENT + away
    height = rng.uniform(0.8, 1.8, int(end / 30) + 2)[stretch[keep]]
    return stand(rng, route, Kind.FENCE, s[keep], side * d, (_RAIL_PIECE, 0.1, height))


def _rails(rng: np.random.Generator, route: Route, end: float, side: float) -> Objects:
    """Return guard rails: always on motorways, in the country by stretches."""
    s = np.arange(0, end, _RAIL_PIECE)
    land = route.land[route.index(s)]
    stretch = rng.random(int(end / 150) + 2)[(s / 150).astype(int)] < 0.45
    keep = (land == Land.MOTORWAY) | ((land == Land.COUNTRY) & stretch)
    keep &= ~route.tunnel[route.index(s)]
    s = s[keep]
    d = route.lookup(route.outer, s) + np.where(land[keep] == Land.MOTORWAY, 3.0, 1.6)
    return stand(rng, route, Kind.RAIL, s, side * d, (_RAIL_PIECE, 0.15, 0.75))


def _median(rng: np.random.Generator, route: Route, end: float) -> Objects:
    """Return the guard rail between the carriageways of a motorway."""
    s = np.arange(0, end, _RAIL_PIECE)
    s = s[route.lookup(route.inner, s) > 1.0]
    return stand(rng, route, Kind.RAIL, s, np.zeros(len(s)), (_RAIL_PIECE, 0.3, 0.8))


def _tunnel_walls(rng: np.random.Generator, route: Route, end: float, side: float) -> Objects:
    """Return a tunnel's wall in pieces."""
    s = np.arange(0, end, _RAIL_PIECE)
    s = s[route.tunnel[route.index(s)]]
    d = route.lookup(route.outer, s) + 2.2
    return stand(rng, route, Kind.WALL, s, side * d, (_RAIL_PIECE, 0.5, 5.5))


def _lights(rng: np.random.Generator, route: Route, end: float) -> list[Objects]:
    """Return the traffic lights at junctions, before it on the right and beyond it on the left."""
    s = route.junctions[route.junctions < end]
    d = route.lookup(route.outer, s) + 1.0
    size = sizes(rng, Kind.TRAFFIC_LIGHT, len(s))
    return [
        stand(rng, route, Kind.TRAFFIC_LIGHT, s - SIDE_STREET + 1, -d, size),
        stand(rng, route, Kind.TRAFFIC_LIGHT, s + SIDE_STREET - 1, d, size),
    ]


def _off_the_road(route: Route, objects: Objects) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which objects keep off the carriageway (inside of a bend they may not)."""
    reach = 200
    keep = np.ones(len(objects), bool)
    bend = np.convolve(np.abs(route.curvature), np.ones(2 * reach), mode="same") * STEP > 0.5
    check = np.flatnonzero(bend[route.index(objects.s)] & (objects.kind != Kind.RAIL))
    offsets = np.arange(-reach, reach + 1, 2)
    near = np.clip(route.index(objects.s[check])[:, None] + offsets, 0, len(route.x) - 1)
    corners = objects[check].corners()
    points = np.concatenate([corners, corners.mean(axis=1, keepdims=True)], axis=1)
    for column in range(5):
        gap = np.hypot(
            route.x[near] - points[:, column, 0, None], route.y[near] - points[:, column, 1, None]
        )
        keep[check] &= (gap > route.outer[near] + 0.05).all(axis=1)
    return keep
