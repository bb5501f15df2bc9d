"""The ego's drive along the road: exact, piecewise of constant acceleration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.world.objects import Floats
from models.world.route import SPEED, STEP, Route

_ACCELERATION = 1.4
_BRAKING = 1.9
_LATERAL = 2.6
_STOP_SPEED = 0.05


@dataclass(frozen=True, slots=True)
class Stop:
    """A stand at a junction's light.

    Attributes
    ----------
    s:
        Where the ego stands, m along the road.
    junction:
        Where the junction is, m along the road.
    start, end:
        When it stands, s.
    queue:
        Vehicles standing between the ego and the light.
    """

    s: float
    junction: float
    start: float
    end: float
    queue: int


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Nodes between which the acceleration is constant; (n,) each.

    Attributes
    ----------
    t, s, v, a:
        Time (s), position (m), speed (m/s) at the node, acceleration (m/s²) after it.
    stops:
        Stands at lights, in order.
    """

    t: Floats
    s: Floats
    v: Floats
    a: Floats
    stops: tuple[Stop, ...]

    def at(self, t_s: Floats) -> tuple[Floats, Floats]:
        """Return position (m) and speed (m/s) at times ``t_s`` (s)."""
        node = np.clip(np.searchsorted(self.t, t_s, side="right") - 1, 0, len(self.t) - 1)
        dt = t_s - self.t[node]
        speed = self.v[node] + self.a[node] * dt
        return self.s[node] + (self.v[node] + speed) / 2 * dt, speed

    def when(self, s: Floats) -> Floats:
        """Return when the ego is at positions ``s`` (m), s; at a stop, when it leaves."""
        node = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)
        gap = s - self.s[node]
        end = np.sqrt(np.maximum(self.v[node] ** 2 + 2 * self.a[node] * gap, 1e-6))
        result: Floats = self.t[node] + 2 * gap / (self.v[node] + end)
        return result


def plan_drive(rng: np.random.Generator, route: Route) -> Drive:
    """Return a drive over the whole route: limits by place and curve, hesitation, red lights.

    The speed profile is the largest one under the limits that never accelerates or brakes
    harder than the constants of this module (the usual forward and backward pass in v²).
    """
    n = len(route.x)
    s = np.arange(n, dtype=np.float64) * STEP
    limit = SPEED[route.land] * rng.uniform(0.7, 1.1)
    curve = np.sqrt(_LATERAL / np.maximum(np.abs(route.curvature), 1e-4))
    limit = np.minimum(limit * _hesitation(rng, n), curve)
    halts = _choose_halts(rng, route)
    node = np.array([round(halt[0] / STEP) for halt in halts], np.intp)
    limit[node] = _STOP_SPEED
    square = limit**2
    backward = np.minimum.accumulate((square + 2 * _BRAKING * s)[::-1])[::-1] - 2 * _BRAKING * s
    both = np.minimum.accumulate(backward - 2 * _ACCELERATION * s) + 2 * _ACCELERATION * s
    v = np.sqrt(np.maximum(both, _STOP_SPEED**2))
    step = 2 * STEP / (v[1:] + v[:-1])
    dwell = np.zeros(n)
    dwell[node] = [halt[2] for halt in halts]
    arrive = np.concatenate([[0.0], np.cumsum(step + dwell[:-1])])
    leave = arrive + dwell
    stops = tuple(
        Stop(float(s[i]), halt[1], float(arrive[i]), float(leave[i]), halt[3])
        for i, halt in zip(node, halts, strict=True)
    )
    a = np.append(np.diff(v) / step, 0.0)
    t, s, v, a = (np.insert(table, node, table[node]) for table in (leave, s, v, a))
    first = node + np.arange(len(node))
    t[first] = arrive[node]
    v[first] = 0.0
    a[first] = 0.0
    return Drive(t, s, v, a, stops)


def _hesitation(rng: np.random.Generator, n: int) -> Floats:
    """Return a factor on the speed along the road: a slow wave, and slow-downs now and then."""
    knots = rng.uniform(0.75, 1.0, n // 80 + 3)
    slow = rng.random(len(knots)) < 0.12
    knots[slow] *= rng.uniform(0.3, 0.7, int(slow.sum()))
    result: Floats = np.interp(np.arange(n) / 80, np.arange(len(knots)), knots)
    return result


def _choose_halts(rng: np.random.Generator, route: Route) -> list[tuple[float, float, float, int]]:
    """Return (position, junction, duration, queue) of the red lights on the way."""
    halts = []
    for junction in route.junctions[route.junctions > 60]:
        red, queue = rng.random() < 0.5, int(rng.integers(0, 3))
        duration = rng.uniform(5, 25)
        if red:
            halts.append((float(np.rint(junction - 13 - 7.5 * queue)), junction, duration, queue))
    return halts
