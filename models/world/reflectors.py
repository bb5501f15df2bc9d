"""Point reflectors of the world: where on an object the radar's energy comes back from.

An object is a handful of points with a mean radar cross section each. Their amplitudes fluctuate
with the aspect: a share of the amplitude is steady, the rest is speckle, made of three waves in
the direction from which the object is seen. So a point fades as the ego drives by (close to
Swerling I where the steady share is small) and stays as it is while the ego stands.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from models.world.objects import Floats, Kind, Objects

_WAVES = 3


@dataclass(frozen=True, slots=True, eq=False)
class Reflectors:
    """N points, (N,) unless said.

    Attributes
    ----------
    owner:
        intp, index of the object that carries the point.
    x, y:
        World coordinates, m.
    vx, vy:
        Velocity, m/s.
    amplitude:
        Square root of the mean radar cross section in m².
    steady:
        Share of the power that does not fluctuate.
    facing:
        Direction out of which the point is seen, rad; NaN where it is seen from all around.
    waves:
        (N, 3, 2) wave vectors of the speckle, rad per metre of displacement.
    phases:
        (N, 3) phases of the speckle, rad.
    """

    owner: NDArray[np.intp]
    x: Floats
    y: Floats
    vx: Floats
    vy: Floats
    amplitude: Floats
    steady: Floats
    facing: Floats
    waves: Floats
    phases: Floats

    def __len__(self) -> int:
        return len(self.x)

    def __getitem__(self, which: slice | NDArray[np.intp] | NDArray[np.bool_]) -> Reflectors:
        return Reflectors(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(frozen=True, slots=True)
class Texture:
    """How a kind of object reflects.

    Attributes
    ----------
    mean, spread:
        Mean radar cross section of a point in dBm² and its standard deviation over points, dB.
    spacing:
        Distance between points along the outline, m; 0: a single point in the middle.
    steady:
        Share of the power that does not fluctuate.
    faced:
        Whether a point is seen only from outside the face it sits on.
    """

    mean: float
    spread: float
    spacing: float
    steady: float
    faced: bool


TEXTURES = {
    Kind.CAR: Texture(2.0, 7.0, 1.1, 0.5, True),
    Kind.VAN: Texture(5.0, 7.0, 1.2, 0.5, True),
    Kind.TRUCK: Texture(9.0, 7.0, 1.6, 0.5, True),
    Kind.PEDESTRIAN: Texture(-6.0, 2.0, 0.0, 0.3, False),
    Kind.POLE: Texture(3.0, 5.0, 0.0, 0.8, False),
    Kind.SIGN: Texture(7.0, 6.0, 0.0, 0.7, False),
    Kind.TRAFFIC_LIGHT: Texture(4.0, 4.0, 0.0, 0.7, False),
    Kind.TREE: Texture(-4.0, 6.0, 2.5, 0.1, False),
    Kind.BUSH: Texture(-7.0, 5.0, 1.5, 0.1, False),
    Kind.BUILDING: Texture(0.0, 9.0, 2.2, 0.6, True),
    Kind.WALL: Texture(-4.0, 7.0, 2.0, 0.6, True),
    Kind.RAIL: Texture(0.0, 6.0, 2.0, 0.7, False),
    Kind.POST: Texture(-3.0, 4.0, 0.0, 0.8, False),
    Kind.GANTRY: Texture(14.0, 5.0, 0.0, 0.7, False),
}


def reflectors(objects: Objects) -> Reflectors:
    """Return the points of all objects; an object's points depend on its ``look`` alone."""
    owner, along, across, facing = _outline(objects)
    count = np.bincount(owner, minlength=len(objects))
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    nth = np.arange(len(owner)) - np.repeat(first, count)
    u = _hashed(objects.look[owner], nth)
    kind = objects.kind[owner]
    mean, spread, steady = (
        np.array([getattr(TEXTURES[k], name) for k in Kind])[kind]
        for name in ("mean", "spread", "steady")
    )
    normal = np.sqrt(-2 * np.log1p(-u[:, 0])) * np.cos(2 * np.pi * u[:, 1])
    cos, sin = np.cos(objects.heading[owner]), np.sin(objects.heading[owner])
    turn = 2 * np.pi * u[:, 2 : 2 + _WAVES]
    size = 2 * np.pi * (0.3 + 2.2 * u[:, 5 : 5 + _WAVES])
    return Reflectors(
        owner,
        objects.x[owner] + along * cos - across * sin,
        objects.y[owner] + along * sin + across * cos,
        objects.vx[owner],
        objects.vy[owner],
        10 ** ((mean + spread * normal) / 20),
        steady,
        facing + objects.heading[owner],
        np.stack([size * np.cos(turn), size * np.sin(turn)], axis=-1),
        2 * np.pi * u[:, 8 : 8 + _WAVES],
    )


def _outline(objects: Objects) -> tuple[NDArray[np.intp], Floats, Floats, Floats]:
    """Return owner, position along and across it (m), and facing (rad from its length axis)."""
    spacing = np.array([TEXTURES[k].spacing for k in Kind])[objects.kind]
    faced = np.array([TEXTURES[k].faced for k in Kind])[objects.kind]
    parts = []
    single = np.flatnonzero(spacing == 0)
    zero = np.zeros(len(single))
    parts.append((single, zero, zero, np.full(len(single), np.nan)))
    several = np.flatnonzero(spacing > 0)
    for facing in (0.0, np.pi / 2, np.pi, -np.pi / 2):
        lengthwise = facing in (np.pi / 2, -np.pi / 2)
        extent = (objects.length if lengthwise else objects.width)[several]
        half = (objects.width if lengthwise else objects.length)[several] / 2
        points = np.maximum(np.rint(extent / spacing[several]).astype(int), 1)
        owner = np.repeat(several, points)
        first = np.concatenate([[0], np.cumsum(points)[:-1]])
        nth = np.arange(len(owner)) - np.repeat(first, points)
        place = ((nth + 0.5) / np.repeat(points, points) - 0.5) * np.repeat(extent, points)
        out = np.repeat(half, points) * (1.0 if facing in (0.0, np.pi / 2) else -1.0)
        pair = (place, out) if lengthwise else (out, place)
        parts.append((owner, *pair, np.where(faced[owner], facing, np.nan)))
    owner, along, across, facing = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(owner, kind="stable")
    return owner[order], along[order], across[order], facing[order]


@lru_cache(maxsize=1)
def _odd() -> NDArray[np.uint64]:
    return np.random.Generator(np.random.Philox(key=1)).integers(
        0, 2**63, 8 + _WAVES, np.uint64
    ) | np.uint64(1)


def _hashed(look: NDArray[np.uint32], nth: NDArray[np.intp]) -> Floats:
    """Return (N, 11) numbers uniform on [0, 1) that depend on ``look`` and ``nth`` alone."""
    with np.errstate(over="ignore"):
        state = look.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        state += (nth.astype(np.uint64) + np.uint64(1)) * np.uint64(0xBF58476D1CE4E5B9)
        state ^= state >> np.uint64(31)
        many = state[:, None] * _odd()
        many ^= many >> np.uint64(29)
        many *= np.uint64(0x94D049BB133111EB)
        many ^= many >> np.uint64(32)
    result: Floats = (many >> np.uint64(11)) * 2.0**-53
    return result
