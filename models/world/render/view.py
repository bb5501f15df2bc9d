"""Where the camera is and how it projects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.world.objects import Floats
from models.world.road import Ego
from models.world.route import STEP, Route


@dataclass(frozen=True, slots=True)
class View:
    """A pinhole camera that looks ahead; its pitch is a shift of the horizon.

    Attributes
    ----------
    x, y, heading:
        Pose in the world, m, rad.
    s:
        Position along the road, m.
    above:
        Height above the ground, m.
    focal:
        Focal length, pixels.
    width, height:
        Of the image, pixels.
    horizon:
        Row of the horizon, pixels.
    """

    x: float
    y: float
    heading: float
    s: float
    above: float
    focal: float
    width: int
    height: int
    horizon: float

    def to_camera(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return distance ahead and to the left (m) of world coordinates."""
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        dx, dy = x - self.x, y - self.y
        return dx * cos + dy * sin, dy * cos - dx * sin

    def pixels(self, points: Floats) -> Floats:
        """Return (..., 2) columns and rows of (..., 3) camera coordinates: ahead, left, up; m."""
        scale = self.focal / points[..., 0]
        result = np.empty((*points.shape[:-1], 2))
        result[..., 0] = self.width / 2 - points[..., 1] * scale
        result[..., 1] = self.horizon + (self.above - points[..., 2]) * scale
        return result


def mount(ego: Ego, ahead: float, above: float, width: int, height: int, horizon: float) -> View:
    """Return the view from ``ahead`` of the rear axle and ``above`` the ground, m."""
    return View(
        x=ego.x + ahead * np.cos(ego.heading),
        y=ego.y + ahead * np.sin(ego.heading),
        heading=ego.heading,
        s=ego.s + ahead,
        above=above,
        focal=0.78 * width,
        width=width,
        height=height,
        horizon=horizon,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Strip:
    """The road as the camera sees it, one entry an image row below the horizon.

    Attributes
    ----------
    row:
        (m,) image rows, from the far end down.
    ahead:
        (m,) distance of the ground there, m.
    s:
        (m,) position along the road, m.
    centre:
        (m,) distance of the road's centreline to the left, m.
    slope:
        (m,) cosine of the road's heading against the camera's.
    """

    row: Floats
    ahead: Floats
    s: Floats
    centre: Floats
    slope: Floats

    def column(self, view: View, d: Floats | float) -> Floats:
        """Return the image columns of lateral offsets ``d`` (m, left), one a row."""
        left = self.centre + d / self.slope
        result: Floats = view.width / 2 - left * view.focal / self.ahead
        return result

    def part(self, rows: slice) -> Strip:
        """Return some of the rows."""
        tables = (self.row, self.ahead, self.s, self.centre, self.slope)
        return Strip(*(table[rows] for table in tables))


def strip(view: View, route: Route, farthest: float = 350.0) -> Strip:
    """Return where the road lies in each row of the image."""
    first = int(np.ceil(view.horizon + view.focal * view.above / farthest))
    row = np.arange(first, view.height, dtype=float)
    ahead = view.focal * view.above / (row - view.horizon)
    s = view.s + np.arange(-5.0, 500.0, STEP)
    x, y, heading = route.place(s, np.zeros(len(s)))
    depth, left = view.to_camera(x, y)
    turn = heading - view.heading
    turn -= 2 * np.pi * np.rint(turn[5] / (2 * np.pi))
    bent = np.flatnonzero((np.abs(turn) > 1.2) | (np.diff(depth, append=depth[-1] + 1) <= 0))
    last = max(int(bent[0]) if len(bent) else len(s), 8)
    depth, left, turn, s = depth[:last], left[:last], turn[:last], s[:last]
    beyond = np.maximum(ahead - depth[-1], 0)
    return Strip(
        row,
        ahead,
        np.interp(ahead, depth, s) + beyond,
        np.interp(ahead, depth, left) + beyond * np.tan(turn[-1]),
        np.cos(np.interp(ahead, depth, turn)),
    )
