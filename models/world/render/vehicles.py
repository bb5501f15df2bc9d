"""Vehicles: a body of shaded faces with glass, wheels, lamps and a plate."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from models.world.objects import Floats, Kind, Objects
from models.world.render.canvas import NEAREST, Canvas

Point = tuple[float, float, float]


class Part(IntEnum):
    """What a face of the body is."""

    PAINT = 0
    GLASS = 1
    TYRE = 2
    RIM = 3
    TRIM = 4
    REAR_LAMP = 5
    FRONT_LAMP = 6
    PLATE = 7


_TINTS = np.array(
    [
        (0, 0, 0), (80, 72, 62), (36, 35, 34), (128, 128, 128), (52, 51, 50),
        (48, 42, 170), (238, 238, 234), (198, 206, 210),
    ],
    float,
)  # fmt: skip
_BRAKING = (110.0, 90.0, 252.0)
_PAINTS = np.array(
    [
        (186, 187, 188), (52, 51, 50), (112, 112, 112), (158, 158, 157), (96, 60, 40),
        (52, 44, 132), (70, 74, 78), (140, 132, 122), (60, 80, 60), (174, 184, 190),
    ],
    float,
)  # fmt: skip
_DETAIL_PIXELS = 14.0
_TRUCK = int(Kind.TRUCK)

_OUTLINES = {
    Kind.CAR: (
        (0.50, 0.16), (0.50, 0.50), (0.47, 0.57), (0.24, 0.66), (0.06, 0.97),
        (-0.27, 1.00), (-0.44, 0.68), (-0.49, 0.62), (-0.50, 0.18),
    ),
    Kind.VAN: (
        (0.50, 0.12), (0.50, 0.40), (0.46, 0.47), (0.37, 0.54), (0.24, 0.97),
        (-0.46, 1.00), (-0.49, 0.54), (-0.495, 0.46), (-0.50, 0.12),
    ),
    Kind.TRUCK: (
        (0.50, 0.10), (0.50, 0.34), (0.498, 0.37), (0.495, 0.42), (0.48, 0.95),
        (-0.498, 1.00), (-0.499, 0.42), (-0.4995, 0.36), (-0.50, 0.14),
    ),
}  # fmt: skip
"""Side view (x, z), from the foot of the front over the roof to the foot of the rear; the
greenhouse stands on the fourth and the seventh point."""

_WHEELS = {Kind.CAR: (0.078, 0.22), Kind.VAN: (0.065, 0.157), Kind.TRUCK: (0.045, 0.139)}
"""Radius of the wheels along x and z."""


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """One polygon of a body of unit size: x −½…½ ahead, y −½…½ left, z 0…1 up.

    Attributes
    ----------
    corners:
        (n, 3).
    normal:
        (3,) in units of the body's own size (divide by the size before use).
    part:
        What it is.
    detail:
        Whether it is left out from afar.
    """

    corners: Floats
    normal: Floats
    part: Part
    detail: bool


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """All faces of a body, those that lie on others last.

    Attributes
    ----------
    corners:
        (n, 3) corners of all faces, one after another.
    first:
        (faces + 1,) where each one's corners begin.
    normals:
        (faces, 3) as in ``Face``.
    parts:
        (faces,) ``Part``.
    details:
        (faces,) whether a face is left out from afar.
    tints:
        (faces, 3) colours; paint is added by vehicle.
    mirrors:
        (faces,) share of the sky's light that a level face throws back.
    """

    corners: Floats
    first: NDArray[np.intp]
    normals: Floats
    parts: NDArray[np.intp]
    details: NDArray[np.bool_]
    tints: Floats
    mirrors: Floats


def _face(corners: Sequence[Point], part: Part, detail: bool = False) -> Face:
    """Return a face, its normal turned outward."""
    points = np.array(corners)
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    outward = points.mean(axis=0) - (0, 0, 0.45)
    return Face(points, normal if normal @ outward > 0 else -normal, part, detail)


@lru_cache(maxsize=len(_OUTLINES))
def _body(kind: Kind) -> Body:
    """Return the faces of a kind of vehicle."""
    outline = _OUTLINES[kind]
    roof = 0.41 if kind == Kind.CAR else 0.485
    half = [roof if place in (4, 5) else 0.5 for place in range(len(outline))]
    faces = []
    for place in range(len(outline) - 1):
        (x, z), (x2, z2) = outline[place], outline[place + 1]
        glass = place == 3 or (place == 5 and kind == Kind.CAR)
        ring = [(x, -half[place], z), (x, half[place], z),
                (x2, half[place + 1], z2), (x2, -half[place + 1], z2)]  # fmt: skip
        faces.append(_face(ring, Part.GLASS if glass else Part.PAINT))
    for side in (1.0, -1.0):
        lower = [outline[place] for place in (0, 1, 2, 3, 6, 7, 8)]
        faces.append(_face([(x, side * 0.5, z) for x, z in lower], Part.PAINT))
        upper = [(outline[place][0], side * half[place], outline[place][1])
                 for place in (3, 4, 5, 6)]  # fmt: skip
        faces.append(_face(upper, Part.GLASS if kind == Kind.CAR else Part.PAINT))
        faces += _side_details(kind, side)
    faces += _end_details(kind)
    parts = np.array([face.part for face in faces])
    return Body(
        np.concatenate([face.corners for face in faces]),
        np.cumsum([0] + [len(face.corners) for face in faces]),
        np.array([face.normal for face in faces]),
        parts,
        np.array([face.detail for face in faces]),
        _TINTS[parts],
        np.array([0.08, 0.30, 0, 0, 0, 0, 0, 0])[parts],
    )


def _side_details(kind: Kind, side: float) -> Iterable[Face]:
    """Yield pillars, side windows and wheels of one side."""
    if kind == Kind.CAR:
        for x in (-0.02, -0.26):
            pillar = [
                (x, 0.5, 0.67),
                (x + 0.03, 0.5, 0.67),
                (x, 0.41, 0.99),
                (x - 0.03, 0.41, 0.99),
            ]
            yield _face([(a, side * b, c) for a, b, c in pillar], Part.PAINT, True)
    else:
        window = [(0.36, 0.56), (0.25, 0.92), (0.12, 0.92), (0.12, 0.56)]
        if kind == Kind.TRUCK:
            window = [(0.485, 0.45), (0.478, 0.68), (0.42, 0.68), (0.42, 0.45)]
        yield _face([(x, side * 0.503, z) for x, z in window], Part.GLASS, True)
    long, radius = _WHEELS[kind]
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    for x in (0.31, -0.31):
        for share, part in ((1.0, Part.TYRE), (0.55, Part.RIM)):
            ring = [
                (x + share * long * float(np.cos(a)), side * 0.51,
                 radius * (1 + share * float(np.sin(a)))) for a in turn
            ]  # fmt: skip
            yield _face(ring, part, share < 1)


def _end_details(kind: Kind) -> Iterable[Face]:
    """Yield bumpers, lamps, plates and the rear window of a van."""
    for x in (0.502, -0.502):
        rear = x < 0
        yield _face(_patch(x, -0.47, 0.47, 0.15, 0.25), Part.TRIM)
        if kind != Kind.CAR and rear:
            yield _face(
                _patch(x, -0.4, 0.4, 0.58, 0.88),
                Part.GLASS if kind == Kind.VAN else Part.PAINT,
                True,
            )
        low, high = ((0.48, 0.60) if rear else (0.40, 0.49)) if kind == Kind.CAR else (0.26, 0.38)
        for side in (1.0, -1.0):
            lamp = Part.REAR_LAMP if rear else Part.FRONT_LAMP
            yield _face(_patch(x, side * 0.31, side * 0.48, low, high), lamp)
        if not rear:
            yield _face(_patch(x, -0.25, 0.25, 0.30, 0.42), Part.TRIM, True)
        yield _face(_patch(x * 1.002, -0.14, 0.14, 0.30, 0.38), Part.PLATE, True)


def _patch(x: float, y: float, y2: float, z: float, z2: float) -> list[Point]:
    """Return an upright rectangle across the body."""
    return [(x, y, z), (x, y2, z), (x, y2, z2), (x, y, z2)]


def paint_vehicle(canvas: Canvas, objects: Objects, i: int, braking: bool, dim: float) -> None:
    """Paint vehicle ``i``; ``dim`` is the factor on the light where it is."""
    view, light = canvas.view, canvas.light
    size = np.array([objects.length[i], objects.width[i], objects.height[i]])
    place = np.array([*view.to_camera(objects.x[i], objects.y[i]), objects.z[i]], float)
    if place[0] + size[0] / 2 < NEAREST:
        return
    body = _body(Kind(objects.kind[i]))
    turn = _turn(objects.heading[i] - view.heading)
    eye = turn.T @ (np.array([0, 0, view.above]) - place)
    corners = body.corners * size
    normals = body.normals / size
    seen = (normals * (eye - corners[body.first[:-1]])).sum(axis=1) > 0
    if view.focal * size[2] / max(place[0], 1.0) < _DETAIL_PIXELS:
        seen &= ~body.details
    normals = normals / np.sqrt((normals**2).sum(axis=1, keepdims=True))
    nx, ny, nz = (normals @ _turn(objects.heading[i]).T).T
    colours = np.where((body.parts == Part.PAINT)[:, None], _paint(objects, i), body.tints)
    colours = colours * light.on(nx, ny, nz)[:, None]
    colours += (body.mirrors * np.maximum(nz, 0))[:, None] * np.asarray(light.zenith)
    if braking:
        colours[body.parts == Part.REAR_LAMP] = _BRAKING
    colours = light.hazed(colours * dim, np.full(len(colours), max(place[0], 0.0)))
    points = corners @ turn.T + place
    canvas.mesh(points, body.first, np.flatnonzero(seen), colours)


def _turn(angle: float) -> Floats:
    """Return the rotation by ``angle`` (rad) about the vertical axis."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _paint(objects: Objects, i: int) -> Floats:
    """Return the paint of vehicle ``i``; trucks are white or gray."""
    look = int(objects.look[i])
    result: Floats = _PAINTS[look % 2 * 3 if objects.kind[i] == _TRUCK else look % len(_PAINTS)]
    return result
