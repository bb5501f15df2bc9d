"""Who moves: leaders and followers, oncoming and overtaking vehicles, side traffic, pedestrians."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from models.world.drive import Drive, Stop
from models.world.objects import Floats, Kind, Objects
from models.world.route import LANE, SPEED, Land, Route
from models.world.scenery import PARKING, PAVEMENT, sizes

_LIFE = 25.0


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """N road users, (N,) each: s(t) = e(t) + s0 + vs·(t − t0), d(t) = d0 + vd·(t − t0).

    e(t) is 0, or, for those that drive with the ego, the ego's own position ``headway`` seconds
    later (Newell's car following: G. F. Newell, "A simplified car-following theory",
    Transportation Research B 36, 2002); they join and leave by an added gap, and may change lane.
    """

    kind: NDArray[np.uint8]
    t0: Floats
    t1: Floats
    s0: Floats
    d0: Floats
    vs: Floats
    vd: Floats
    with_ego: NDArray[np.bool_]
    headway: Floats
    lane: Floats
    change: Floats
    length: Floats
    width: Floats
    height: Floats
    look: NDArray[np.uint32]


def populate(rng: np.random.Generator, route: Route, drive: Drive, duration: float) -> Tracks:
    """Return all road users that the ego meets in ``duration`` seconds."""
    parts = [
        _oncoming(rng, route, drive, duration),
        _overtaking(rng, route, drive, duration),
        _convoy(rng, drive, duration),
        _pedestrians(rng, route, drive, duration),
        *(_at_light(rng, route, stop) for stop in drive.stops if stop.start < duration),
    ]
    return Tracks(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Tracks)))


def move(tracks: Tracks, route: Route, drive: Drive, t_s: float) -> Objects:
    """Return the road users at time ``t_s`` (s) that are then on the road."""
    here = float(drive.at(np.asarray(t_s))[0])
    now = (tracks.t0 - _LIFE < t_s) & (t_s < tracks.t1 + _LIFE)
    now &= ~tracks.with_ego | ((tracks.t0 < t_s) & (t_s < tracks.t1))
    chosen = Tracks(*(getattr(tracks, field.name)[now] for field in fields(Tracks)))
    dt = t_s - chosen.t0
    s, vs = chosen.s0 + chosen.vs * dt, chosen.vs.copy()
    d, vd = chosen.d0 + chosen.vd * dt, chosen.vd.copy()
    company = chosen.with_ego
    place, speed = drive.at(t_s + chosen.headway[company])
    gap, closing = _join_and_leave(dt[company], (chosen.t1 - t_s)[company])
    sign = np.sign(chosen.headway[company])
    s[company] += place + sign * gap
    vs[company] += speed + sign * closing
    across, drift = _ramp(dt[company] - 3.0, 4.0)
    room = route.lookup(route.outer, s) - route.lookup(route.inner, s) - LANE
    aside = chosen.lane[company] * room[company]
    other = chosen.change[company] * room[company] * (1 - 2 * chosen.lane[company])
    d[company] = route.drive_offset(s[company]) + aside + other * (1 - across)
    vd[company] = -other * drift
    on_road = (np.abs(s - here) < 320) & (s > 1) & (s < route.length - 1)
    on_road &= (chosen.lane == 0) | (room > LANE / 2)
    chosen = Tracks(*(getattr(chosen, field.name)[on_road] for field in fields(Tracks)))
    return _as_objects(chosen, route, s[on_road], d[on_road], vs[on_road], vd[on_road])


def _as_objects(
    tracks: Tracks, route: Route, s: Floats, d: Floats, vs: Floats, vd: Floats
) -> Objects:
    """Return the boxes of tracks at road positions with speeds along and across the road."""
    x, y, heading = route.place(s, d)
    along = vs * (1 - d * route.lookup(route.curvature, s))
    moving = np.hypot(vs, vd) > 0.1
    turned = np.where(moving, np.arctan2(vd, along), np.arctan2(tracks.vd, tracks.vs))
    cos, sin = np.cos(heading), np.sin(heading)
    return Objects(
        tracks.kind,
        s,
        x,
        y,
        np.zeros(len(s)),
        heading + turned,
        tracks.length,
        tracks.width,
        tracks.height,
        along * cos - vd * sin,
        along * sin + vd * cos,
        tracks.look,
    )


def _ramp(t: Floats, duration: float) -> tuple[Floats, Floats]:
    """Return the smooth step from 0 to 1 over ``duration`` and its derivative (1/s)."""
    share = np.clip(t / duration, 0, 1)
    value: Floats = share**2 * (3 - 2 * share)
    return value, 6 * share * (1 - share) / duration


def _join_and_leave(since: Floats, until: Floats) -> tuple[Floats, Floats]:
    """Return the extra gap (m) with which company joins and leaves, and its rate (m/s)."""
    joined, joining = _ramp(since, 9.0)
    leaving, parting = _ramp(until, 9.0)
    return 130 * (2 - joined - leaving), 130 * (parting - joining)


def _tracks(
    rng: np.random.Generator, kind: NDArray[np.uint8], t0: Floats, **given: Floats | float
) -> Tracks:
    """Return tracks of the given kinds; what is not given is zero, life ends at ``t0``."""
    n = len(kind)
    length, width, height = np.empty(n), np.empty(n), np.empty(n)
    for which in np.unique(kind):
        chosen = kind == which
        size = sizes(rng, Kind(which), int(chosen.sum()))
        length[chosen], width[chosen], height[chosen] = size
    values = {name: np.broadcast_to(np.asarray(v, float), n) for name, v in given.items()}
    values.setdefault("t1", t0)
    for name in ("s0", "d0", "vs", "vd", "headway", "lane", "change"):
        values.setdefault(name, np.zeros(n))
    return Tracks(
        kind=kind,
        t0=t0,
        with_ego=np.full(n, "headway" in given),
        length=length,
        width=width,
        height=height,
        look=rng.integers(0, 2**32, n, np.uint32),
        **values,
    )


def _kinds(rng: np.random.Generator, n: int) -> NDArray[np.uint8]:
    """Return a mix of vehicles."""
    return rng.choice([Kind.CAR, Kind.VAN, Kind.TRUCK], n, p=[0.78, 0.14, 0.08]).astype(np.uint8)


def _times(rng: np.random.Generator, duration: float, interval: float) -> Floats:
    """Return Poisson times from before the start until after the end, s."""
    count = int((duration + 2 * _LIFE) / interval * 1.5) + 10
    times = np.cumsum(rng.exponential(interval, count)) - _LIFE
    result: Floats = times[times < duration + _LIFE]
    return result


def _land(route: Route, s: Floats) -> NDArray[np.uint8]:
    return route.land[route.index(s)]


def _oncoming(rng: np.random.Generator, route: Route, drive: Drive, duration: float) -> Tracks:
    """Return oncoming vehicles by when they meet the ego; thinner where the road is quieter."""
    t0 = _times(rng, duration, 3.0)
    s0 = drive.at(t0)[0]
    land = _land(route, s0)
    keep = rng.random(len(t0)) < np.array([0.4, 0.3, 0.8])[land]
    t0, s0, land = t0[keep], s0[keep], land[keep]
    inner = route.lookup(route.inner, s0)
    room = route.lookup(route.outer, s0) - inner - LANE
    d0 = inner + LANE / 2 + room * rng.integers(0, 2, len(t0))
    speed = SPEED[land] * rng.uniform(0.7, 1.1, len(t0))
    return _tracks(rng, _kinds(rng, len(t0)), t0, s0=s0, d0=d0, vs=-speed)


def _overtaking(rng: np.random.Generator, route: Route, drive: Drive, duration: float) -> Tracks:
    """Return vehicles in the inner lane of a motorway, faster or slower than the ego."""
    t0 = _times(rng, duration, 5.0)
    s0, speed = drive.at(t0)
    around = [_land(route, drive.at(t0 + dt)[0]) == Land.MOTORWAY for dt in (-12.0, 0.0, 12.0)]
    keep = np.logical_and.reduce(around)
    t0, s0, speed = t0[keep], s0[keep], speed[keep]
    d0 = -route.lookup(route.inner, s0) - LANE / 2
    vs = speed + rng.choice([-1.0, 1.0, 1.0], len(t0)) * rng.uniform(2, 8, len(t0))
    return _tracks(rng, _kinds(rng, len(t0)), t0, s0=s0, d0=d0, vs=vs)


def _convoy(rng: np.random.Generator, drive: Drive, duration: float) -> Tracks:
    """Return who drives around the ego for a while, and who queues at lights."""
    parts = [
        _slot(rng, drive, duration, lane, place)
        for lane, place in ((0, 1), (0, 2), (0, 3), (0, -1), (1, 0), (1, 1), (1, 2), (1, -1))
    ]
    return Tracks(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Tracks)))


def _slot(rng: np.random.Generator, drive: Drive, duration: float, lane: int, place: int) -> Tracks:
    """Return those who, one after another, drive ``place`` vehicles ahead of the ego in a lane."""
    count = int((duration + 2 * _LIFE) / 25) + 2
    stay = rng.uniform(25, 80, count)
    t1 = np.cumsum(stay + rng.exponential(12.0, count)) - 2 * _LIFE
    t0 = t1 - stay
    free = np.ones(count, bool)
    for stop in drive.stops:
        if lane == 0 and place > stop.queue:
            free &= (t1 < stop.start - 3) | (t0 > stop.end + 3)
    t0, t1 = t0[free], t1[free]
    n = len(t0)
    sign = 1.0 if place >= 0 else -1.0
    headway = place * rng.uniform(1.0, 2.0, n) + sign * rng.uniform(0.01, 0.4, n)
    s0 = place * 7.5 + lane * rng.uniform(-3, 3, n)
    change = np.where(rng.random(n) < 0.3, 1.0, 0.0)
    return _tracks(
        rng, _kinds(rng, n), t0, t1=t1, s0=s0, headway=headway, lane=float(lane), change=change
    )


def _pedestrians(rng: np.random.Generator, route: Route, drive: Drive, duration: float) -> Tracks:
    """Return people walking on the pavements of towns, by where the ego passes them."""
    end = float(drive.at(np.asarray(duration))[0]) + 100
    s0 = np.sort(rng.uniform(0, end, int(end / 12)))
    s0 = s0[_land(route, s0) == Land.CITY]
    n = len(s0)
    side = rng.choice([-1.0, 1.0], n)
    d0 = side * (route.lookup(route.outer, s0) + PARKING + rng.uniform(0.5, PAVEMENT - 0.5, n))
    vs = rng.choice([-1.0, 1.0], n) * rng.uniform(0.7, 1.7, n)
    kind = np.full(n, Kind.PEDESTRIAN, np.uint8)
    return _tracks(rng, kind, drive.when(s0), s0=s0, d0=d0, vs=vs)


def _at_light(rng: np.random.Generator, route: Route, stop: Stop) -> Tracks:
    """Return side traffic and people who cross before the standing ego."""
    cars = stop.start + np.cumsum(rng.exponential(1.8, 14))
    cars = cars[cars < stop.end - 2]
    walkers = rng.uniform(stop.start + 1, max(stop.end - 4, stop.start + 2), rng.integers(0, 5))
    kind = np.concatenate([_kinds(rng, len(cars)), np.full(len(walkers), Kind.PEDESTRIAN)])
    sign = rng.choice([-1.0, 1.0], len(kind))
    person = kind == Kind.PEDESTRIAN
    outer = float(route.lookup(route.outer, np.asarray(stop.junction)))
    s0 = np.where(person, stop.junction - 9, stop.junction + sign * LANE / 2)
    speed = np.where(person, rng.uniform(1.0, 1.6, len(kind)), rng.uniform(6, 12, len(kind)))
    t0 = np.concatenate([cars, walkers])
    d0 = np.where(person, -sign * (outer + 1), 0.0)
    return _tracks(rng, kind.astype(np.uint8), t0, s0=s0, d0=d0, vd=sign * speed)
