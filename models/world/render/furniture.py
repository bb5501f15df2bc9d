"""What stands along a road: poles, signs, lights, rails, fences, posts, gantries; and people."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from models.world.objects import Floats, Kind, Objects
from models.world.render.canvas import NEAREST, Canvas

_STEEL = np.array([128.0, 128.0, 126.0])
_SIGNS = np.array([(170, 90, 40), (40, 40, 176), (206, 206, 206), (60, 130, 60), (40, 180, 205)],
                  float)  # fmt: skip
_CLOTHES = np.array([(60, 54, 50), (110, 70, 50), (60, 60, 140), (150, 150, 150), (52, 80, 60)],
                    float)  # fmt: skip
_SKIN = np.array([110.0, 134.0, 172.0])
_LAMPS = np.array([(60, 60, 250), (60, 200, 250), (120, 230, 80)], float)


class _Stand:
    """One object's place, seen from the camera; gathers upright patches at it."""

    def __init__(self, canvas: Canvas, objects: Objects, i: int) -> None:
        view = canvas.view
        self.ahead, self.left = (float(v) for v in view.to_camera(objects.x[i], objects.y[i]))
        turn = float(objects.heading[i] - view.heading)
        self.along = math.cos(turn), math.sin(turn)
        self.across = -math.sin(turn), math.cos(turn)
        self.pixels = view.focal / max(self.ahead, NEAREST)
        self.points: list[float] = []
        self.colours: list[Floats] = []

    def upright(
        self, half: float, low: float, high: float, colour: Floats, offset: float = 0.0
    ) -> None:
        """Add a patch that faces the camera: half width, foot and top, m to the left."""
        left = self.left + offset
        self._add(self.ahead, left + half, self.ahead, left - half, low, high, colour)

    def panel(
        self,
        one: float,
        other: float,
        low: float,
        high: float,
        colour: Floats,
        axis: tuple[float, float] | None = None,
    ) -> None:
        """Add a patch along the object's length axis, or another one: ends and heights, m."""
        x, y = axis or self.along
        self._add(
            self.ahead + one * x,
            self.left + one * y,
            self.ahead + other * x,
            self.left + other * y,
            low,
            high,
            colour,
        )

    def _add(
        self, x: float, y: float, x2: float, y2: float, low: float, high: float, colour: Floats
    ) -> None:
        self.points += (x, y, low, x2, y2, low, x2, y2, high, x, y, high)
        self.colours.append(colour)

    def paint(self, canvas: Canvas, dim: float) -> None:
        """Paint all patches, in order."""
        points = np.array(self.points).reshape(-1, 4, 3)
        colours = np.array(self.colours) * dim
        hazed = canvas.light.hazed(colours, np.full(len(colours), max(self.ahead, 0.0)))
        canvas.faces(points, hazed)


def paint_furniture(canvas: Canvas, objects: Objects, i: int, dim: float, t_s: float) -> None:
    """Paint object ``i``; ``dim`` is the factor on the light where it is."""
    stand = _Stand(canvas, objects, i)
    if stand.ahead < NEAREST and objects.length[i] < 1:
        return
    size = float(objects.height[i]), float(objects.width[i]) / 2, float(objects.length[i]) / 2
    _BUILDERS[int(objects.kind[i])](stand, size, int(objects.look[i]), t_s)
    stand.paint(canvas, dim)


Size = tuple[float, float, float]
"""Height, half width, half length, m."""


def _pole(stand: _Stand, size: Size, look: int, t_s: float) -> None:
    high = size[0]
    stand.upright(0.09, 0, high, _STEEL * 0.8)
    stand.upright(0.03, 0, high, _STEEL * 1.1, offset=0.04)
    toward = 1.0 if stand.left < 0 else -1.0
    stand.upright(0.8, high, high + 0.1, _STEEL, offset=toward * 0.8)
    stand.upright(0.35, high - 0.02, high + 0.16, _STEEL * 1.4, offset=toward * 1.6)


def _sign(stand: _Stand, size: Size, look: int, t_s: float) -> None:
    high, half, _ = size
    stand.upright(0.04, 0, high, _STEEL)
    face = _SIGNS[look % len(_SIGNS)]
    stand.upright(half, high - 2 * half, high, np.full(3, 205.0))
    stand.upright(half * 0.86, high - 1.86 * half, high - 0.14 * half, face)
    if stand.pixels > 25:
        ink = np.full(3, 225.0 if face.mean() < 150 else 40.0)
        for row in range(2 + look % 2):
            level = high - half * (0.5 + 0.45 * row)
            stand.upright(half * (0.62 - 0.15 * row), level - 0.16 * half, level, ink)


def _traffic_light(stand: _Stand, size: Size, look: int, t_s: float) -> None:
    high = size[0]
    stand.upright(0.06, 0, high, _STEEL * 0.7)
    stand.upright(0.17, high - 0.95, high, np.array([36.0, 40.0, 38.0]))
    lit = 0 if (t_s + look % 20) % 40 < 22 else 2
    for lamp in range(3):
        level = high - 0.17 - 0.31 * lamp
        colour = _LAMPS[lamp] if lamp == lit else _LAMPS[lamp] * 0.25
        stand.upright(0.10, level - 0.10, level + 0.10, colour)


def _rail(stand: _Stand, size: Size, look: int, t_s: float) -> None:
    high, _, half = size
    if stand.pixels > 12:
        for place in (-half, 0.0):
            stand.panel(place, place + 0.12, 0, high, _STEEL * 0.75)
    for low, top, tone in ((0.42, 0.53, 0.85), (0.53, 0.63, 1.2), (0.63, 0.75, 1.0)):
        stand.panel(-half, half, low * high / 0.75, top * high / 0.75, _STEEL * tone)


def _fence(stand: _Stand, size: Size, look: int, t_s: float) -> None:
    high, _, half = size
    tone = np.array([[90.0, 100.0, 112.0], [120.0, 126.0, 130.0], [70.0, 92.0, 82.0]])[look % 3]
    if look % 2:
        stand.panel(-half, half, 0, high, tone)
        stand.panel(-half, half, high - 0.1, high, tone * 1.3)
        return
    stand.panel(-half, half, high * 0.85, high, tone)
    stand.panel(-half, half, high * 0.15, high * 0.28, tone)
    count = 14 if stand.pixels > 18 else 5
    for place in np.linspace(-half, half, count, endpoint=False):
        stand.panel(place, place + 0.08, 0, high, tone * 0.9)


def _post(stand: _Stand, size: Size, look: int, t_s: float) -> None:
    high, half, _ = size
    if look % 3:
        stand.upright(half / 2, 0, high, np.array([70.0, 72.0, 74.0]))
        stand.upright(half / 2, high * 0.75, high * 0.9, np.array([196.0, 198.0, 200.0]))
    else:
        stand.upright(half * 1.6, 0, high, np.array([58.0, 92.0, 66.0]) * (1 + look % 5 / 4))
        stand.upright(half * 1.7, high * 0.88, high, np.array([50.0, 56.0, 52.0]))


def _gantry(stand: _Stand, size: Size, look: int, t_s: float) -> None:
    high = size[0]
    reach = -math.copysign(7.0, stand.left)
    stand.upright(0.2, 0, high, _STEEL)
    stand.panel(0, reach, high - 0.4, high, _STEEL * 0.8, axis=stand.across)
    face = _SIGNS[0] if look % 2 else _SIGNS[3]
    stand.panel(
        reach * 0.3, reach * 0.95, high - 2.4, high - 0.2, np.full(3, 215.0), axis=stand.across
    )
    stand.panel(reach * 0.31, reach * 0.94, high - 2.3, high - 0.3, face, axis=stand.across)
    for row in range(2):
        level = high - 0.8 - 0.7 * row
        stand.panel(
            reach * 0.38,
            reach * (0.85 - 0.1 * row),
            level - 0.3,
            level,
            np.full(3, 226.0),
            axis=stand.across,
        )


def _person(stand: _Stand, size: Size, look: int, t_s: float) -> None:
    high = size[0]
    coat, legs = _CLOTHES[look % len(_CLOTHES)], _CLOTHES[(look // 7) % len(_CLOTHES)] * 0.7
    stride = 0.16 * np.sin(6.0 * t_s + look % 7)
    for side in (1.0, -1.0):
        stand.upright(0.075, 0, 0.48 * high, legs, offset=side * (0.09 + stride * 0.5))
        stand.upright(0.05, 0.45 * high, 0.80 * high, coat * 0.85, offset=side * 0.23)
    stand.upright(0.19, 0.45 * high, 0.84 * high, coat)
    stand.upright(0.085, 0.85 * high, high, _SKIN)
    stand.upright(0.09, 0.95 * high, high, np.array([40.0, 46.0, 54.0]))


_BUILDERS: dict[int, Callable[[_Stand, Size, int, float], None]] = {
    Kind.POLE: _pole,
    Kind.SIGN: _sign,
    Kind.TRAFFIC_LIGHT: _traffic_light,
    Kind.RAIL: _rail,
    Kind.FENCE: _fence,
    Kind.POST: _post,
    Kind.GANTRY: _gantry,
    Kind.PEDESTRIAN: _person,
}
