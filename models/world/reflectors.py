"""Point reflectors of the world: where on an object the radar's energy comes back from.

An object is a handful of points with a mean radar cross section each. Their amplitudes fluctuate
with the aspect: a share of the power is steady, the rest is speckle, made of three waves over the
displacement between radar and object. So a point fades as the ego drives by (close to Swerling I
where the steady share is small) and stays as it is while the ego stands.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from models.world.objects import Floats, Kind, Objects

_WAVES = 3
_COLUMNS = 9 + _WAVES


@dataclass(frozen=True, slots=True, eq=False)
class Reflectors:
    """N points, (N,) unless said.

    Attributes
    ----------
    owner:
        intp, index of the object that carries the point.
    x, y:
        (N,) m, relative to the owner's centre and length axis, or placed in the world.
    nx, ny:
        Unit vector out of which the point is seen, in the same frame; zero: from all around.
    amplitude:
        Square root of the mean radar cross section in m².
    steady:
        Share of the power that does not fluctuate.
    waves:
        (N, 3, 2) wave vectors of the speckle, rad per metre of displacement.
    phases:
        (N, 3) phases of the speckle, rad.
    chance:
        Unchanging number of the point, uniform on [0, 1), by which the sensor judges it.
    """

    owner: NDArray[np.intp]
    x: Floats
    y: Floats
    nx: Floats
    ny: Floats
    amplitude: Floats
    steady: Floats
    waves: Floats
    phases: Floats
    chance: Floats

    def __len__(self) -> int:
        return len(self.x)

    def __getitem__(self, which: slice | NDArray[np.intp] | NDArray[np.bool_]) -> Reflectors:
        return Reflectors(*(getattr(self, field.name)[which] for field in fields(self)))

    def placed(self, objects: Objects) -> Reflectors:
        """Return the points in world coordinates; ``owner`` indexes ``objects``."""
        cos, sin = np.cos(objects.heading)[self.owner], np.sin(objects.heading)[self.owner]
        return Reflectors(
            self.owner,
            objects.x[self.owner] + self.x * cos - self.y * sin,
            objects.y[self.owner] + self.x * sin + self.y * cos,
            self.nx * cos - self.ny * sin,
            self.nx * sin + self.ny * cos,
            self.amplitude,
            self.steady,
            self.waves,
            self.phases,
            self.chance,
        )


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
    Kind.CAR: Texture(4.0, 9.5, 1.0, 0.5, True),
    Kind.VAN: Texture(7.0, 9.5, 1.2, 0.5, True),
    Kind.TRUCK: Texture(10.0, 9.5, 1.4, 0.5, True),
    Kind.PEDESTRIAN: Texture(-3.0, 5.5, 0.0, 0.3, False),
    Kind.POLE: Texture(7.0, 8.5, 0.0, 0.8, False),
    Kind.SIGN: Texture(9.0, 8.5, 0.0, 0.7, False),
    Kind.TRAFFIC_LIGHT: Texture(8.0, 7.5, 0.0, 0.7, False),
    Kind.TREE: Texture(-1.0, 9.5, 2.0, 0.2, False),
    Kind.BUSH: Texture(-3.0, 8.5, 1.2, 0.2, False),
    Kind.BUILDING: Texture(4.0, 11.5, 1.5, 0.6, True),
    Kind.WALL: Texture(0.0, 9.5, 1.5, 0.6, True),
    Kind.RAIL: Texture(3.0, 8.5, 1.3, 0.7, False),
    Kind.POST: Texture(1.0, 8.5, 0.0, 0.8, False),
    Kind.GANTRY: Texture(15.0, 8.5, 0.0, 0.7, False),
    Kind.FENCE: Texture(1.0, 9.5, 1.3, 0.5, False),
}


def reflectors(
    kind: NDArray[np.uint8], length: Floats, width: Floats, look: NDArray[np.uint32]
) -> Reflectors:
    """Return the points of N objects, in each one's own frame, sorted by owner.

    The points of an object depend on these four values of its own alone.
    """
    owner, x, y, nx, ny = _outline(kind, length, width)
    count = np.bincount(owner, minlength=len(kind))
    nth = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    u = _hashed(look[owner], nth)
    mean, spread, steady = (_by_kind(name)[kind[owner]] for name in ("mean", "spread", "steady"))
    normal = np.sqrt(-2 * np.log1p(-u[:, 0])) * np.cos(2 * np.pi * u[:, 1])
    normal = np.where(normal > 1, normal + 0.35 * (normal - 1), normal)
    turn = 2 * np.pi * u[:, 2 : 2 + _WAVES]
    size = 2 * np.pi * (0.3 + 2.2 * u[:, 5 : 5 + _WAVES])
    return Reflectors(
        owner,
        x,
        y,
        nx,
        ny,
        10 ** ((mean + spread * normal) / 20),
        steady,
        np.stack([size * np.cos(turn), size * np.sin(turn)], axis=-1),
        2 * np.pi * u[:, 8 : 8 + _WAVES],
        u[:, 8 + _WAVES],
    )


def join(one: Reflectors, other: Reflectors) -> Reflectors:
    """Return the points of both, in order."""
    return Reflectors(
        *(np.concatenate([getattr(one, f.name), getattr(other, f.name)]) for f in fields(one))
    )


def _by_kind(name: str) -> Floats:
    """Return one attribute of ``TEXTURES`` as a table over kinds."""
    return np.array([float(getattr(TEXTURES[kind], name)) for kind in Kind])


def _outline(
    kind: NDArray[np.uint8], length: Floats, width: Floats
) -> tuple[NDArray[np.intp], Floats, Floats, Floats, Floats]:
    """Return owner, place (m) and outward normal of the points of N objects, sorted by owner."""
    spacing, faced = _by_kind("spacing")[kind], _by_kind("faced")[kind]
    single, several = np.flatnonzero(spacing == 0), np.flatnonzero(spacing > 0)
    zero = np.zeros(len(single))
    parts = [(single, zero, zero, zero, zero)]
    for nx, ny in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
        side, depth = (width, length) if nx else (length, width)
        points = np.maximum(np.rint(side[several] / spacing[several]).astype(int), 1)
        owner = np.repeat(several, points)
        nth = np.arange(len(owner)) - np.repeat(np.cumsum(points) - points, points)
        place = ((nth + 0.5) / np.repeat(points, points) - 0.5) * side[owner]
        x = nx * depth[owner] / 2 + abs(ny) * place
        y = ny * depth[owner] / 2 + abs(nx) * place
        parts.append((owner, x, y, nx * faced[owner], ny * faced[owner]))
    owner, x, y, along, across = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(owner, kind="stable")
    return owner[order], x[order], y[order], along[order], across[order]


def _hashed(look: NDArray[np.uint32], nth: NDArray[np.intp]) -> Floats:
    """Return (N, 12) numbers uniform on [0, 1) that depend on ``look`` and ``nth`` alone.

    Multiply and xor-shift, after the finaliser of SplitMix64 (Steele, Lea, Flood, "Fast
    splittable pseudorandom number generators", OOPSLA 2014).
    """
    first, second, third = (np.uint64(n) for n in (30, 27, 31))
    with np.errstate(over="ignore"):
        start = (look.astype(np.uint64) << np.uint64(16)) + nth.astype(np.uint64)
        columns = np.arange(1, 1 + _COLUMNS, dtype=np.uint64)
        state: NDArray[np.uint64] = start[:, None] * np.uint64(_COLUMNS) + columns
        state *= np.uint64(0x9E3779B97F4A7C15)
        state = (state ^ (state >> first)) * np.uint64(0xBF58476D1CE4E5B9)
        state = (state ^ (state >> second)) * np.uint64(0x94D049BB133111EB)
        state ^= state >> third
    result: Floats = (state >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return result
