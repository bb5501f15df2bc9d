"""A picture in the making: polygons in camera coordinates, shaded, hazed and antialiased."""

from __future__ import annotations

from dataclasses import dataclass
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from models.world.objects import Floats
from models.world.render.light import Light
from models.world.render.textures import Image
from models.world.render.view import View

NEAREST = 0.5
"""Nothing nearer than this is drawn, m."""

_SHIFT = 4
_LIMIT = 8000.0


@dataclass(frozen=True, slots=True, eq=False)
class Canvas:
    """The picture and all that every brush needs.

    Attributes
    ----------
    image:
        (height, width, 3) uint8, coded radiance, BGR.
    view:
        Where the camera is.
    light:
        How the world is lit.
    """

    image: Image
    view: View
    light: Light

    def fill(self, u: Floats, v: Floats, colour: Sequence[float] | Floats) -> None:
        """Fill a convex polygon given by columns and rows, pixels."""
        fill(self.image, u, v, colour)

    def face(self, ahead: Floats, left: Floats, up: Floats, colour: Sequence[float] | Floats) -> None:
        """Fill a convex polygon given in camera coordinates, m; parts too near are cut off."""
        ahead, left, up = clip_near(ahead, left, up)
        if len(ahead) > 2:
            u, v = self.view.project(ahead, left, up)
            if u.max() >= 0 and u.min() <= self.view.width and v.max() >= 0:
                self.fill(u, v, colour)


def fill(image: Image, u: Floats, v: Floats, colour: Sequence[float] | Floats) -> None:
    """Fill a convex polygon in an image or a mask, antialiased."""
    points = np.stack([np.clip(u, -_LIMIT, _LIMIT), np.clip(v, -_LIMIT, _LIMIT)], axis=1)
    raw = np.rint(points * 2**_SHIFT).astype(np.int32)
    cv2.fillConvexPoly(image, raw, tuple(map(float, colour)), cv2.LINE_AA, _SHIFT)


def clip_near(ahead: Floats, left: Floats, up: Floats) -> tuple[Floats, Floats, Floats]:
    """Cut a polygon at the plane ``ahead`` = ``NEAREST`` (Sutherland, Hodgman, CACM 1974)."""
    if ahead.min() >= NEAREST:
        return ahead, left, up
    points = np.stack([ahead, left, up], axis=1)
    kept: list[NDArray[np.float64]] = []
    for one, other in zip(points, np.roll(points, -1, axis=0), strict=True):
        if one[0] >= NEAREST:
            kept.append(one)
        if (one[0] >= NEAREST) != (other[0] >= NEAREST):
            kept.append(one + (NEAREST - one[0]) / (other[0] - one[0]) * (other - one))
    result = np.array(kept).reshape(-1, 3)
    return result[:, 0], result[:, 1], result[:, 2]
