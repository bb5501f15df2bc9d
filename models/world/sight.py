"""What the radar's wave meets on its way: geometry, speckle and shadows of one moment."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from models.world.objects import Floats, Kind, Objects
from models.world.points import Motion, Points
from models.world.reflectors import Reflectors

_SPAN = np.radians(76.0)
_RAYS = 153
_SOLID = np.isin(np.arange(len(Kind)), (Kind.BUILDING, Kind.WALL))
_BODY = np.isin(np.arange(len(Kind)), (Kind.CAR, Kind.VAN, Kind.TRUCK))
_BEHIND_SOLID, _BEHIND_BODY = 0.2, 0.5
_DEPTH = 0.7
_SCREENED_M = 160.0
_CLOSE_M = 20.0
_FAINT = 10 ** (-16 / 20)
_MIRRORING, _TWICE = 10 ** (12 / 20), 10 ** (-24 / 20)
_SLOPE = np.tan(np.radians(75.0))


@dataclass(frozen=True, slots=True)
class Antenna:
    """Where the radar is and how it moves.

    Attributes
    ----------
    x, y, heading:
        World coordinates, m, rad.
    ahead, left:
        Its own velocity along and across its axis, m/s.
    yaw_rate:
        rad/s.
    """

    x: float
    y: float
    heading: float
    ahead: float
    left: float
    yaw_rate: float

    def to_sensor(self, dx: Floats, dy: Floats) -> tuple[Floats, Floats]:
        """Return world vectors in the sensor's axes (ahead, left)."""
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        return dx * cos + dy * sin, dy * cos - dx * sin


def look(antenna: Antenna, reflectors: Reflectors, objects: Objects, first_mobile: int) -> Points:
    """Return what every reflector in sight sends back.

    Parameters
    ----------
    antenna:
        From where.
    reflectors:
        Placed in the world.
    objects:
        Their owners; from ``first_mobile`` on road users, before it what never moves.
    """
    dx, dy = reflectors.x - antenna.x, reflectors.y - antenna.y
    ahead, left = antenna.to_sensor(dx, dy)
    r = np.hypot(ahead, left)
    facing = -(dx * reflectors.nx + dy * reflectors.ny) / np.maximum(r, 0.1)
    facing[(reflectors.nx == 0) & (reflectors.ny == 0)] = 1.0
    seen = np.flatnonzero(
        (np.abs(left) < _SLOPE * ahead)
        & (r < 260)
        & (r > 0.3)
        & (facing > -0.1)
        & (reflectors.amplitude > _FAINT)
    )
    reflectors = reflectors[seen]
    ahead, left, r, dx, dy, facing = (a[seen] for a in (ahead, left, r, dx, dy, facing))
    azimuth = np.arctan2(left, ahead)
    amplitude = reflectors.amplitude * (r**2 / (r**2 + _CLOSE_M**2)) ** 0.75
    amplitude *= np.sqrt(np.minimum(facing + 0.1, 1.0)) * _shadow(antenna, objects, r, azimuth)
    vx, vy = objects.vx[reflectors.owner], objects.vy[reflectors.owner]
    over_ground = (vx * dx + vy * dy) / r
    waves = reflectors.waves
    direct = Points(
        r,
        azimuth,
        over_ground - (antenna.ahead * ahead + antenna.left * left) / r,
        amplitude,
        reflectors.steady,
        reflectors.phases + waves[..., 0] * dx[:, None] + waves[..., 1] * dy[:, None],
        _motion(np.hypot(vx, vy), over_ground, reflectors.owner >= first_mobile),
        reflectors.chance,
    )
    return _with_mirrored(direct)


def _with_mirrored(points: Points) -> Points:
    """Add what went to and fro twice between a strong near target and the ego's own front."""
    strong = points[(points.r < 45) & (points.amplitude > _MIRRORING)]
    twice = replace(
        strong,
        r=2 * strong.r,
        speed=2 * strong.speed,
        amplitude=strong.amplitude * _TWICE,
        motion=np.full(len(strong.r), Motion.MIRRORED, np.uint8),
    )
    pairs = ((getattr(points, f.name), getattr(twice, f.name)) for f in fields(Points))
    return Points(*(np.concatenate(pair) for pair in pairs))


def _motion(pace: Floats, over_ground: Floats, mobile: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return ``Motion`` by speed over ground and its share along the line of sight, m/s."""
    motion = np.where(mobile, Motion.STOPPED, Motion.STANDING)
    motion[pace > 0.3] = Motion.MOVING
    motion[(pace > 0.3) & (np.abs(over_ground) < 0.7 * pace)] = Motion.CROSSING
    return motion.astype(np.uint8)


def _shadow(antenna: Antenna, objects: Objects, r: Floats, azimuth: Floats) -> Floats:
    """Return the factor on the amplitude behind buildings and, half let through, vehicles."""
    ahead, left = antenna.to_sensor(objects.x - antenna.x, objects.y - antenna.y)
    near = (ahead > -15) & (np.abs(ahead) + np.abs(left) < _SCREENED_M)
    ray = np.rint((azimuth + _SPAN) * ((_RAYS - 1) / (2 * _SPAN))).astype(np.intp)
    factor = np.ones(len(r))
    for kinds, passed in ((_SOLID, _BEHIND_SOLID), (_BODY, _BEHIND_BODY)):
        hit = _first_hit(antenna, objects[near & kinds[objects.kind]])
        factor[r > hit[ray] + _DEPTH] *= passed
    return factor


def _first_hit(antenna: Antenna, boxes: Objects) -> Floats:
    """Return the range at which each ray of the fan first meets a box, (rays,) m; inf: never.

    The slab method (Kay, Kajiya, "Ray tracing complex scenes", SIGGRAPH 1986) in the box's frame.
    """
    fan = antenna.heading + np.linspace(-_SPAN, _SPAN, _RAYS)
    turn = fan - boxes.heading[:, None]
    cos, sin = np.cos(boxes.heading), np.sin(boxes.heading)
    dx, dy = antenna.x - boxes.x, antenna.y - boxes.y
    entry, leave = np.full(turn.shape, 0.0), np.full(turn.shape, np.inf)
    for start, step, half in (
        (dx * cos + dy * sin, np.cos(turn), boxes.length / 2),
        (dy * cos - dx * sin, np.sin(turn), boxes.width / 2),
    ):
        inverse = 1 / np.where(np.abs(step) < 1e-9, 1e-9, step)
        one, two = (-half - start)[:, None] * inverse, (half - start)[:, None] * inverse
        entry = np.maximum(entry, np.minimum(one, two))
        leave = np.minimum(leave, np.maximum(one, two))
    hit = np.where((entry < leave) & (entry > 0), entry, np.inf)
    result: Floats = hit.min(axis=0, initial=np.inf)
    return result
