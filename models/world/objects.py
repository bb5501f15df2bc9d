"""What stands and moves beside the road, as a structure of arrays."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Kind(IntEnum):
    """Kinds of objects."""

    CAR = 0
    VAN = 1
    TRUCK = 2
    PEDESTRIAN = 3
    POLE = 4
    SIGN = 5
    TRAFFIC_LIGHT = 6
    TREE = 7
    BUSH = 8
    BUILDING = 9
    WALL = 10
    RAIL = 11
    POST = 12
    GANTRY = 13
    FENCE = 14


VEHICLES = (Kind.CAR, Kind.VAN, Kind.TRUCK)


@dataclass(frozen=True, slots=True, eq=False)
class Objects:
    """N upright boxes in world coordinates; all arrays have length N.

    Attributes
    ----------
    kind:
        uint8, ``Kind``.
    s:
        Position along the road, m.
    x, y, z:
        Centre of the footprint and height of its bottom edge, m.
    heading:
        Direction of the length axis, rad, counter-clockwise from x.
    length, width, height:
        Size, m.
    vx, vy:
        Velocity, m/s.
    look:
        uint32, unchanging number of the object that seeds its appearance and reflectivity.
    """

    kind: NDArray[np.uint8]
    s: Floats
    x: Floats
    y: Floats
    z: Floats
    heading: Floats
    length: Floats
    width: Floats
    height: Floats
    vx: Floats
    vy: Floats
    look: NDArray[np.uint32]

    def __len__(self) -> int:
        return len(self.kind)

    def __getitem__(self, which: slice | NDArray[np.intp] | NDArray[np.bool_]) -> Objects:
        return Objects(*(getattr(self, field.name)[which] for field in fields(self)))

    def corners(self) -> Floats:
        """Return the footprints' corners, (N, 4, 2), m, counter-clockwise from front left."""
        along = np.array([0.5, -0.5, -0.5, 0.5])
        across = np.array([0.5, 0.5, -0.5, -0.5])
        forward = np.stack([np.cos(self.heading), np.sin(self.heading)], axis=-1)[:, None]
        left = np.stack([-np.sin(self.heading), np.cos(self.heading)], axis=-1)[:, None]
        centre = np.stack([self.x, self.y], axis=-1)[:, None]
        result: Floats = (
            centre
            + (self.length[:, None] * along)[..., None] * forward
            + (self.width[:, None] * across)[..., None] * left
        )
        return result


def concatenate(parts: Iterable[Objects]) -> Objects:
    """Return all objects of all parts, in order."""
    parts = list(parts)
    return Objects(
        *(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Objects))
    )
