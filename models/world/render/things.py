"""Objects as shaded boxes."""

from __future__ import annotations

import cv2
import numpy as np

from models.world.objects import Kind, Objects
from models.world.render.textures import Image
from models.world.render.view import View

_SHIFT = 4
_NEAREST = 0.6
_FACES = np.array([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [4, 5, 6, 7]])
_SHADE = np.array([0.75, 1.0, 0.7, 0.6, 1.1])

_COLOUR = {
    Kind.PEDESTRIAN: (70, 60, 90),
    Kind.POLE: (120, 120, 118),
    Kind.SIGN: (150, 160, 170),
    Kind.TRAFFIC_LIGHT: (40, 50, 40),
    Kind.TREE: (40, 75, 60),
    Kind.BUSH: (45, 85, 70),
    Kind.WALL: (130, 132, 134),
    Kind.RAIL: (160, 160, 158),
    Kind.POST: (180, 180, 180),
    Kind.GANTRY: (110, 120, 110),
}


def paint_things(image: Image, view: View, objects: Objects) -> None:
    """Paint all boxes, the farthest first."""
    ahead, _ = view.to_camera(objects.x, objects.y)
    corners = objects.corners()
    depth, left = view.to_camera(corners[..., 0], corners[..., 1])
    visible = np.flatnonzero((depth.min(axis=1) > _NEAREST) & (ahead < 300))
    for i in visible[np.argsort(-ahead[visible])]:
        _box(image, view, objects, int(i), depth[i], left[i])


def _box(
    image: Image, view: View, objects: Objects, i: int, depth: np.ndarray, left: np.ndarray
) -> None:
    bottom = objects.z[i]
    z = np.repeat([bottom, bottom + objects.height[i]], 4)
    u, v = view.project(np.tile(depth, 2), np.tile(left, 2), z)
    if u.max() < 0 or u.min() > view.width:
        return
    points = np.stack([u, v], axis=1)[_FACES]
    edge1, edge2 = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    front = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0] < 0
    look = int(objects.look[i])
    base = (
        np.array(
            _COLOUR.get(Kind(objects.kind[i]), ())
            or (look & 127, (look >> 8) & 127, (look >> 16) & 127)
        )
        + 60.0
    )
    raw = np.rint(points * 2**_SHIFT).astype(np.int32)
    for face in np.flatnonzero(front):
        colour = tuple(float(c) for c in np.clip(base * _SHADE[face], 0, 255))
        cv2.fillConvexPoly(image, raw[face], colour, cv2.LINE_AA, _SHIFT)
