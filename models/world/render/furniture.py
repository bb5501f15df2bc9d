"""What stands along a road: poles, signs, lights, rails, fences, posts, gantries; and people."""

from __future__ import annotations

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
    """One object's place, seen from the camera; paints upright patches at it."""

    def __init__(self, canvas: Canvas, objects: Objects, i: int, dim: float) -> None:
        view = canvas.view
        self.canvas = canvas
        self.ahead, self.left = (float(v) for v in view.to_camera(objects.x[i], objects.y[i]))
        turn = float(objects.heading[i] - view.heading)
        self.along = np.array([np.cos(turn), np.sin(turn)])
        self.across = np.array([-np.sin(turn), np.cos(turn)])
        self.dim = dim
        self.pixels = view.focal / max(self.ahead, NEAREST)

    def upright(self, half: float, low: float, high: float, colour: Floats,
                offset: float = 0.0, lift: float = 0.0) -> None:
        """Paint a patch that faces the camera: half width, foot and top in m."""
        if self.ahead < NEAREST:
            return
        left = self.left + offset + np.array([half, -half, -half, half])
        up = np.array([low, low, high, high]) + lift
        self._paint(np.full(4, self.ahead), left, up, colour)

    def panel(self, one: float, other: float, low: float, high: float, colour: Floats,
              direction: Floats | None = None) -> None:
        """Paint a patch along the object's length axis, or another direction: ends, heights, m."""
        axis = self.along if direction is None else direction
        reach = np.array([one, other, other, one])
        self._paint(self.ahead + reach * axis[0], self.left + reach * axis[1],
                    np.array([low, low, high, high]), colour)

    def _paint(self, ahead: Floats, left: Floats, up: Floats, colour: Floats) -> None:
        shaded = self.canvas.light.hazed(np.asarray(colour) * self.dim, np.asarray(self.ahead))
        self.canvas.face(ahead, left, up, shaded)


def paint_furniture(canvas: Canvas, objects: Objects, i: int, dim: float, t_s: float) -> None:
    """Paint object ``i``; ``dim`` is the factor on the light where it is."""
    stand = _Stand(canvas, objects, i, dim)
    look, high = int(objects.look[i]), float(objects.height[i])
    kind = objects.kind[i]
    if kind == Kind.POLE:
        _pole(stand, high)
    elif kind == Kind.SIGN:
        _sign(stand, high, float(objects.width[i]) / 2, look)
    elif kind == Kind.TRAFFIC_LIGHT:
        _traffic_light(stand, high, look, t_s)
    elif kind == Kind.RAIL:
        _rail(stand, high, float(objects.length[i]) / 2)
    elif kind == Kind.FENCE:
        _fence(stand, high, float(objects.length[i]) / 2, look)
    elif kind == Kind.POST:
        _post(stand, high, float(objects.width[i]) / 2, look)
    elif kind == Kind.GANTRY:
        _gantry(stand, high, 1.0 if look % 2 else -1.0)
    elif kind == Kind.PEDESTRIAN:
        _person(stand, high, look, t_s)


def _pole(stand: _Stand, high: float) -> None:
    stand.upright(0.09, 0, high, _STEEL * 0.8)
    stand.upright(0.03, 0, high, _STEEL * 1.1, offset=0.04)
    toward = 1.0 if stand.left < 0 else -1.0
    stand.upright(0.8, high, high + 0.1, _STEEL, offset=toward * 0.8)
    stand.upright(0.35, high - 0.02, high + 0.16, _STEEL * 1.4, offset=toward * 1.6)


def _sign(stand: _Stand, high: float, half: float, look: int) -> None:
    stand.upright(0.04, 0, high, _STEEL)
    face = _SIGNS[look % len(_SIGNS)]
    stand.upright(half, high - 2 * half, high, np.full(3, 205.0))
    stand.upright(half * 0.86, high - 1.86 * half, high - 0.14 * half, face)
    if stand.pixels > 25:
        ink = np.full(3, 225.0 if face.mean() < 150 else 40.0)
        for row in range(2 + look % 2):
            level = high - half * (0.5 + 0.45 * row)
            stand.upright(half * (0.62 - 0.15 * row), level - 0.16 * half, level, ink)


def _traffic_light(stand: _Stand, high: float, look: int, t_s: float) -> None:
    stand.upright(0.06, 0, high, _STEEL * 0.7)
    stand.upright(0.17, high - 0.95, high, np.array([36.0, 40.0, 38.0]))
    lit = 0 if (t_s + look % 20) % 40 < 22 else 2
    for lamp in range(3):
        level = high - 0.17 - 0.31 * lamp
        colour = _LAMPS[lamp] if lamp == lit else _LAMPS[lamp] * 0.25
        stand.upright(0.10, level - 0.10, level + 0.10, colour)


def _rail(stand: _Stand, high: float, half: float) -> None:
    if stand.pixels > 12:
        for place in (-half, 0.0):
            stand.panel(place, place + 0.12, 0, high, _STEEL * 0.75)
    for low, top, tone in ((0.42, 0.53, 0.85), (0.53, 0.63, 1.2), (0.63, 0.75, 1.0)):
        stand.panel(-half, half, low * high / 0.75, top * high / 0.75, _STEEL * tone)


def _fence(stand: _Stand, high: float, half: float, look: int) -> None:
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


def _post(stand: _Stand, high: float, half: float, look: int) -> None:
    if look % 3:
        stand.upright(half / 2, 0, high, np.array([70.0, 72.0, 74.0]))
        stand.upright(half / 2, high * 0.75, high * 0.9, np.array([196.0, 198.0, 200.0]))
    else:
        stand.upright(half * 1.6, 0, high, np.array([58.0, 92.0, 66.0]) * (1 + look % 5 / 4))
        stand.upright(half * 1.7, high * 0.88, high, np.array([50.0, 56.0, 52.0]))


def _gantry(stand: _Stand, high: float, side: float) -> None:
    reach = -np.sign(stand.left or 1.0) * 7.0
    stand.upright(0.2, 0, high, _STEEL)
    stand.panel(0, reach, high - 0.4, high, _STEEL * 0.8, direction=stand.across)
    face = _SIGNS[0] if side > 0 else _SIGNS[3]
    stand.panel(reach * 0.3, reach * 0.95, high - 2.4, high - 0.2, np.full(3, 215.0),
                direction=stand.across)
    stand.panel(reach * 0.31, reach * 0.94, high - 2.3, high - 0.3, face, direction=stand.across)
    for row in range(2):
        level = high - 0.8 - 0.7 * row
        stand.panel(reach * 0.38, reach * (0.85 - 0.1 * row), level - 0.3, level,
                    np.full(3, 226.0), direction=stand.across)


def _person(stand: _Stand, high: float, look: int, t_s: float) -> None:
    coat, legs = _CLOTHES[look % len(_CLOTHES)], _CLOTHES[(look // 7) % len(_CLOTHES)] * 0.7
    stride = 0.16 * np.sin(6.0 * t_s + look % 7)
    for side in (1.0, -1.0):
        stand.upright(0.075, 0, 0.48 * high, legs, offset=side * (0.09 + stride * 0.5))
        stand.upright(0.05, 0.45 * high, 0.80 * high, coat * 0.85, offset=side * 0.23)
    stand.upright(0.19, 0.45 * high, 0.84 * high, coat)
    stand.upright(0.085, 0.85 * high, high, _SKIN)
    stand.upright(0.09, 0.95 * high, high, np.array([40.0, 46.0, 54.0]))
