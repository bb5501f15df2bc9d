"""Where the other road users of the simulated world really are, and which of them can be seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.world.objects import VEHICLES, Floats, Kind, Objects
from models.world.render.view import View
from models.world.road import World

NEAREST_M, FARTHEST_M = 4.0, 60.0
"""Ahead of the camera: where road users are asked for."""
HALF_VIEW = np.radians(28.0)
"""To either side: as far as the camera sees a whole car."""
SEEN = 0.5
"""Share of its width that must be in sight for a road user to be asked for."""
AROUND_M = 2.0
"""So near to something ignored, a detection may be of that."""

_RAYS = 1024
_BODIES = np.isin(np.arange(len(Kind)), VEHICLES)
_OPAQUE = _BODIES | np.isin(np.arange(len(Kind)), (Kind.BUILDING, Kind.WALL))


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Road users that a detector should report, and those that it may.

    Coordinates are the camera's: x ahead, y to the left, m. The place of a road user is the middle
    of the side that it turns to the camera: what a camera sees and what a radar echoes from.

    Attributes
    ----------
    places:
        (n, 2) of the road users that a detector should report.
    ignored:
        (m, 5) centre x and y, heading (rad), length and width of what is neither right nor wrong
        to report: parked vehicles, and road users that are hidden or at the edge of the view.
    """

    places: Floats
    ignored: Floats

    def ignores(self, points: Floats) -> NDArray[np.bool_]:
        """Return which of (k, 2) points are no false alarm: ignored, or where nothing is asked."""
        centre, heading, size = self.ignored[:, :2], self.ignored[:, 2], self.ignored[:, 3:]
        dx, dy = np.moveaxis(points[:, None] - centre, -1, 0)
        cos, sin = np.cos(heading), np.sin(heading)
        along, across = np.abs(dx * cos + dy * sin), np.abs(dy * cos - dx * sin)
        reach = size / 2 + AROUND_M
        near = ((along < reach[:, 0]) & (across < reach[:, 1])).any(axis=1)
        return np.asarray(near | ~asked(points))


def asked(points: Floats) -> NDArray[np.bool_]:
    """Return which of (n, 2) points lie where road users are asked for."""
    ahead, left = points[:, 0], points[:, 1]
    inside = (ahead > NEAREST_M) & (ahead < FARTHEST_M)
    return np.asarray(inside & (np.abs(np.arctan2(left, ahead)) < HALF_VIEW))


def truth(world: World, view: View, t_s: float) -> Truth:
    """Return the road users at ``t_s`` seconds from the start, as the camera has them in sight."""
    moving, objects = world.moving(t_s), world.objects(t_s)
    own = np.arange(len(objects)) >= len(objects) - len(moving)
    places = faces(view, objects)
    wanted = own & (visible(view, objects) >= SEEN) & asked(places)
    other = (own | _BODIES[objects.kind]) & ~wanted
    ahead, left = view.to_camera(objects.x, objects.y)
    heading = objects.heading - view.heading
    boxes = np.stack([ahead, left, heading, objects.length, objects.width], axis=1)
    return Truth(places[wanted], boxes[other])


def faces(view: View, objects: Objects) -> Floats:
    """Return the middle of the side that each object turns to the camera, (n, 2) m."""
    centre = np.stack(view.to_camera(objects.x, objects.y), axis=1)[:, None]
    angle = (objects.heading - view.heading)[:, None] + np.pi / 2 * np.arange(4)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    half = np.stack([objects.length, objects.width], axis=1)[:, [0, 1, 0, 1], None] / 2
    middles = centre + half * normals
    distance = np.hypot(middles[..., 0], middles[..., 1])
    facing = -(middles * normals).sum(axis=-1) / np.maximum(distance, 0.1)
    result: Floats = middles[np.arange(len(objects)), facing.argmax(axis=1)]
    return result


def visible(view: View, objects: Objects) -> Floats:
    """Return which share of each object's width the camera sees past nearer opaque ones, (n,).

    Heights are left out: who is behind a car is taken for hidden.
    """
    corners = objects.corners()
    ahead, left = view.to_camera(corners[..., 0], corners[..., 1])
    column = left / np.maximum(ahead, 0.5) * view.focal / view.width + 0.5
    first = np.floor(np.clip(column.min(axis=1), 0, 1) * _RAYS).astype(int)
    last = np.ceil(np.clip(column.max(axis=1), 0, 1) * _RAYS).astype(int)
    shares = np.zeros(len(objects))
    free: NDArray[np.bool_] = np.ones(_RAYS, bool)
    candidates = np.flatnonzero((ahead.max(axis=1) > 0.5) & (last > first))
    for i in candidates[np.argsort(ahead[candidates].min(axis=1))]:
        whole = np.ptp(column[i]) * _RAYS
        shares[i] = min(1.0, float(free[first[i] : last[i]].sum() / max(whole, 1.0)))
        if _OPAQUE[objects.kind[i]]:
            free[first[i] : last[i]] = False
    return shares
