"""A picture in the making: polygons in camera coordinates, shaded, hazed and antialiased."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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

    def face(self, points: Floats, colour: Floats) -> None:
        """Fill a convex polygon of (n, 3) camera coordinates, m; what is too near is cut off."""
        points = clip_near(points)
        if len(points) > 2:
            fill(self.image, self.view.pixels(points), colour)

    def faces(self, points: Floats, colours: Floats) -> None:
        """Fill (k, n, 3) polygons in order with (k, 3) colours."""
        if points[..., 0].min() < NEAREST:
            for polygon, colour in zip(points, colours, strict=True):
                self.face(polygon, colour)
            return
        pixels = fixed_point(self.view.pixels(points))
        for polygon, tone in zip(pixels, colours.tolist(), strict=True):
            cv2.fillConvexPoly(self.image, polygon, tone, cv2.LINE_AA, _SHIFT)

    def mesh(
        self, points: Floats, first: NDArray[np.intp], chosen: NDArray[np.intp], colours: Floats
    ) -> None:
        """Fill the ``chosen`` ones of polygons that lie one after another in (n, 3) points."""
        starts, tones = first.tolist(), colours.tolist()
        if points[:, 0].min() < NEAREST:
            for face in chosen.tolist():
                self.face(points[starts[face] : starts[face + 1]], colours[face])
            return
        pixels = fixed_point(self.view.pixels(points))
        for face in chosen.tolist():
            polygon = pixels[starts[face] : starts[face + 1]]
            cv2.fillConvexPoly(self.image, polygon, tones[face], cv2.LINE_AA, _SHIFT)


def fixed_point(pixels: Floats) -> NDArray[np.int32]:
    """Return pixel coordinates as OpenCV's drawing functions take them here."""
    limited = np.minimum(np.maximum(pixels, -_LIMIT), _LIMIT)
    result: NDArray[np.int32] = np.rint(limited * 2**_SHIFT).astype(np.int32)
    return result


def fill(image: Image, pixels: Floats, colour: Sequence[float] | Floats) -> None:
    """Fill a convex polygon of (n, 2) columns and rows in an image or a mask, antialiased."""
    cv2.fillConvexPoly(image, fixed_point(pixels), tuple(map(float, colour)), cv2.LINE_AA, _SHIFT)


def fill_any(image: Image, pixels: Floats, colour: Sequence[float]) -> None:
    """Fill a polygon that need not be convex."""
    cv2.fillPoly(image, [fixed_point(pixels)], tuple(map(float, colour)), cv2.LINE_AA, _SHIFT)


def clip_near(points: Floats) -> Floats:
    """Cut a polygon, (n, 3) ahead, left, up, at ``NEAREST`` (Sutherland, Hodgman, CACM 1974)."""
    if points[:, 0].min() >= NEAREST:
        return points
    kept: list[Floats] = []
    for one, other in zip(points, np.roll(points, -1, axis=0), strict=True):
        if one[0] >= NEAREST:
            kept.append(one)
        if (one[0] >= NEAREST) != (other[0] >= NEAREST):
            kept.append(one + (NEAREST - one[0]) / (other[0] - one[0]) * (other - one))
    return np.array(kept).reshape(-1, 3)
