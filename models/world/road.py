"""The simulated world: a road, an ego that drives along it, and all that the ego meets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.degrade.draw import DrawKey
from models.world.drive import plan_drive
from models.world.objects import Floats, Objects, concatenate
from models.world.route import STEP, Route, lay
from models.world.scenery import furnish
from models.world.traffic import move, populate

EPOCH_NS = 1_700_000_000_000_000_000
"""Stamp of the world's start, integer nanoseconds."""

START = 60.0
"""Where on the road the drive begins, m."""

_FASTEST = 33.0
_SIGHT = 400.0


@dataclass(frozen=True, slots=True)
class Ego:
    """The ego vehicle at one moment; the pose is of the middle of its rear axle (ISO 8855).

    Attributes
    ----------
    s:
        Position along the road, m.
    x, y, heading:
        World coordinates, m, rad.
    speed:
        m/s.
    yaw_rate:
        rad/s, counter-clockwise positive.
    """

    s: float
    x: float
    y: float
    heading: float
    speed: float
    yaw_rate: float


def _path(route: Route) -> Floats:
    """Return the ego's path by table index, (5, n).

    Its rows are x, y, heading, metres of path per metre of road, and curvature.
    """
    s = np.arange(len(route.x), dtype=np.float64) * STEP
    x, y, _ = route.place(s, route.drive_offset(s))
    dx, dy = np.gradient(x, STEP), np.gradient(y, STEP)
    heading = np.unwrap(np.arctan2(dy, dx))
    ratio = np.hypot(dx, dy)
    return np.stack([x, y, heading, ratio, np.gradient(heading, STEP) / ratio])


class World:
    """A road and a drive along it, the same for the same seed.

    Parameters
    ----------
    seed:
        Seeds everything.
    duration_s:
        Length of the drive, s.
    """

    def __init__(self, seed: int, duration_s: float) -> None:
        def draw(what: str) -> np.random.Generator:
            return DrawKey(seed, "world", 0).generator(what)

        self.seed = seed
        self.duration_s = duration_s
        margin = 60.0
        self.route = lay(draw("route"), (duration_s + margin) * _FASTEST + 2 * _SIGHT)
        self.drive = plan_drive(draw("drive"), self.route)
        self._path = _path(self.route)
        self._t_start = float(self.drive.when(np.asarray(START)))
        end = float(self.drive.at(np.asarray(self._t_start + duration_s))[0]) + _SIGHT
        self.scenery = furnish(draw("scenery"), self.route, end)
        self.traffic = populate(draw("traffic"), self.route, self.drive, self._t_start + duration_s)

    def ego(self, t_s: float) -> Ego:
        """Return the ego at ``t_s`` seconds from the start."""
        s, rate = self.drive.at(np.asarray(self._t_start + t_s))
        x, y, heading, ratio, curvature = self.route.lookup(self._path, s)
        speed = rate * ratio
        return Ego(*map(float, (s, x, y, heading, speed, curvature * speed)))

    def standing(self, s: float, behind: float = 40.0, ahead: float = 280.0) -> slice:
        """Return the slice of ``scenery`` from ``behind`` to ``ahead`` of ``s``, m."""
        first, last = np.searchsorted(self.scenery.s, [s - behind, s + ahead])
        return slice(int(first), int(last))

    def moving(self, t_s: float) -> Objects:
        """Return the other road users at ``t_s`` seconds from the start."""
        return move(self.traffic, self.route, self.drive, self._t_start + t_s)

    def objects(self, t_s: float) -> Objects:
        """Return everything around the ego at ``t_s`` seconds from the start."""
        here = self.standing(self.ego(t_s).s)
        return concatenate([self.scenery[here], self.moving(t_s)])
