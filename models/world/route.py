"""The road itself: its centreline and its cross-section."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from models.world.objects import Floats

STEP = 1.0
"""Spacing of the tables along the road, m."""

LANE = 3.5
"""Lane width, m."""


class Land(IntEnum):
    """What kind of place the road runs through."""

    CITY = 0
    COUNTRY = 1
    MOTORWAY = 2


SPEED = np.array([12.5, 23.0, 30.0])
"""Speed at which traffic flows, m/s, by ``Land``."""

_SECTION = {Land.CITY: (350, 1100), Land.COUNTRY: (400, 1000), Land.MOTORWAY: (700, 2000)}
_RADIUS = {Land.CITY: (60, 350), Land.COUNTRY: (130, 700), Land.MOTORWAY: (800, 4000)}
_INNER = np.array([0.0, 0.0, 1.5])


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """A road by tables of spacing ``STEP``; lateral offsets d are positive to the left.

    Attributes
    ----------
    x, y, heading, curvature:
        (n,) centreline, m, rad, 1/m.
    land:
        (n,) uint8, ``Land``.
    inner, outer:
        (n,) distance of the inner and outer edge of each carriageway from the centreline, m.
    tunnel:
        (n,) bool, whether the road is roofed.
    junctions:
        Positions of crossings with side streets, m along the road.
    """

    x: Floats
    y: Floats
    heading: Floats
    curvature: Floats
    land: NDArray[np.uint8]
    inner: Floats
    outer: Floats
    tunnel: NDArray[np.bool_]
    junctions: Floats

    @property
    def length(self) -> float:
        """Length of the road, m."""
        return (len(self.x) - 1) * STEP

    def index(self, s: Floats) -> NDArray[np.intp]:
        """Return the table index at positions ``s`` (clamped to the road)."""
        return np.clip(np.rint(s / STEP), 0, len(self.x) - 1).astype(np.intp)

    def lookup(self, table: Floats, s: Floats) -> Floats:
        """Return a table (or rows of tables) of this route at ``s``, linearly interpolated."""
        place = s / STEP
        whole = np.minimum(np.maximum(place, 0), table.shape[-1] - 2).astype(np.intp)
        rest = place - whole
        result: Floats = table[..., whole] * (1 - rest) + table[..., whole + 1] * rest
        return result

    def place(self, s: Floats, d: Floats) -> tuple[Floats, Floats, Floats]:
        """Return x, y (m) and the road's heading (rad) at ``s`` along and ``d`` left, m."""
        heading = self.lookup(self.heading, s)
        x = self.lookup(self.x, s) - d * np.sin(heading)
        y = self.lookup(self.y, s) + d * np.cos(heading)
        return x, y, heading

    def drive_offset(self, s: Floats) -> Floats:
        """Return the lateral offset of the ego's lane (the rightmost one), m."""
        return LANE / 2 - self.lookup(self.outer, s)


def lay(rng: np.random.Generator, length: float) -> Route:
    """Return a random road of at least ``length`` metres."""
    n = int(length / STEP) + 2
    land, lanes = _sections(rng, n)
    junctions = _junctions(rng, land)
    curvature = _curvature(rng, land, junctions)
    heading = np.concatenate([[0.0], np.cumsum((curvature[1:] + curvature[:-1]) / 2 * STEP)])
    middle = (heading[1:] + heading[:-1]) / 2
    inner = _smooth(_smooth(_INNER[land], 90), 60)
    return Route(
        x=np.concatenate([[0.0], np.cumsum(np.cos(middle) * STEP)]),
        y=np.concatenate([[0.0], np.cumsum(np.sin(middle) * STEP)]),
        heading=heading,
        curvature=curvature,
        land=land,
        inner=inner,
        outer=inner + LANE * _smooth(_smooth(lanes, 90), 60),
        tunnel=_tunnels(rng, land),
        junctions=junctions,
    )


def _smooth(table: Floats, width: int) -> Floats:
    """Return the moving average over ``width`` entries, edges held."""
    padded = np.pad(table, (width // 2, width - 1 - width // 2), mode="edge")
    total = np.cumsum(np.concatenate([[0.0], padded]))
    result: Floats = (total[width:] - total[:-width]) / width
    return result


def _sections(rng: np.random.Generator, n: int) -> tuple[NDArray[np.uint8], Floats]:
    """Return land and lanes a direction: random sections, never the same kind twice running."""
    land, lanes = np.empty(n, np.uint8), np.empty(n)
    kind, start = Land(rng.choice(3, p=[0.6, 0.2, 0.2])), 0
    while start < n:
        end = start + int(rng.integers(*_SECTION[kind]) / STEP)
        land[start:end] = kind
        wide = kind == Land.MOTORWAY or (kind == Land.CITY and rng.random() < 0.6)
        lanes[start:end] = 2.0 if wide else 1.0
        others = [other for other in Land if other != kind]
        weights = np.array([3.0 if other == Land.CITY else 1.0 for other in others])
        kind, start = others[rng.choice(2, p=weights / weights.sum())], end
    return land, lanes


def _junctions(rng: np.random.Generator, land: NDArray[np.uint8]) -> Floats:
    """Return the positions of the junctions: every 90 to 220 m, in towns only."""
    places = np.cumsum(rng.uniform(90, 220, int(len(land) * STEP / 90) + 1))
    places = places[places < (len(land) - 1) * STEP]
    margin = np.array([-25, 25])
    ends = np.clip(((places[:, None] + margin) / STEP).astype(int), 0, len(land) - 1)
    result: Floats = places[(land[ends] == Land.CITY).all(axis=1)]
    return result


def _curvature(rng: np.random.Generator, land: NDArray[np.uint8], junctions: Floats) -> Floats:
    """Return the curvature, 1/m: straights, curves and, in towns, tight bends off junctions."""
    curvature = np.zeros(len(land))
    start = 0
    while start < len(land):
        kind = Land(land[start])
        end = start + int(rng.uniform(40, 150) / STEP)
        sign = rng.choice([-1.0, 1.0])
        bent = rng.random() < 0.6
        radius = np.exp(rng.uniform(*np.log(_RADIUS[kind])))
        turn = rng.random() < 0.12
        if kind == Land.CITY and turn:
            radius, bent = rng.uniform(14, 30), True
            end = start + int(radius * rng.uniform(0.9, 1.6) / STEP)
            bent = not np.any(np.abs(junctions - start * STEP) < 60)
        if bent:
            curvature[start:end] = sign / radius
        start = end + int(20 / STEP)
    return _smooth(curvature, int(15 / STEP))


def _tunnels(rng: np.random.Generator, land: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return where the road is roofed: 150 to 400 m now and then, outside towns."""
    tunnel = np.zeros(len(land), bool)
    start = int(rng.uniform(100, 1500) / STEP)
    while start < len(land):
        end = start + int(rng.uniform(150, 400) / STEP)
        stretch = land[max(start - 100, 0) : end + 100]
        if not np.any(stretch == Land.CITY):
            tunnel[start:end] = True
        start = end + int(rng.uniform(600, 2500) / STEP)
    return tunnel
