"""The simulated drive: one seed, one world; motion that agrees with itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.world.objects import VEHICLES, Kind
from models.world.road import World
from models.world.route import STEP


@pytest.fixture(scope="module")
def world() -> World:
    return World(7, 120.0)


def test_one_seed_gives_one_world() -> None:
    one, other = World(5, 30.0), World(5, 30.0)
    for t_s in (0.0, 11.3, 29.9):
        assert one.ego(t_s) == other.ego(t_s)
        a, b = one.objects(t_s), other.objects(t_s)
        assert np.array_equal(a.x, b.x)
        assert np.array_equal(a.look, b.look)
    assert World(6, 30.0).ego(10.0) != one.ego(10.0)


def test_the_ego_moves_as_its_speed_and_yaw_rate_say(world: World) -> None:
    dt = 0.01
    t = np.arange(0.0, 118.0, dt)
    ego = [world.ego(float(s)) for s in t]
    x, y, heading, speed, yaw_rate = (
        np.array([getattr(e, name) for e in ego])
        for name in ("x", "y", "heading", "speed", "yaw_rate")
    )
    travelled = np.hypot(np.diff(x), np.diff(y)) / dt
    assert np.allclose(travelled, (speed[1:] + speed[:-1]) / 2, atol=0.05)
    assert np.allclose(np.diff(heading) / dt, (yaw_rate[1:] + yaw_rate[:-1]) / 2, atol=0.02)
    course = np.angle(np.exp(1j * (np.arctan2(np.diff(y), np.diff(x)) - heading[1:])))
    assert np.abs(course[travelled > 1]).max() < 0.02


def test_the_ego_stands_at_its_red_lights_and_nowhere_brakes_harder_than_a_driver() -> None:
    worlds = [World(seed, 120.0) for seed in range(6)]
    assert any(world.drive.stops for world in worlds)
    for world in worlds:
        assert world.drive.a.max() < 1.5
        assert world.drive.a.min() > -2.0
        for stop in world.drive.stops:
            s, speed = world.drive.at(np.array([stop.start + 0.01, stop.end - 0.01]))
            assert np.allclose(s, stop.s)
            assert np.allclose(speed, 0.0)


@settings(max_examples=10)
@given(st.integers(0, 2**31), st.floats(0.1, 19.0))
def test_road_users_move_as_their_velocities_say(seed: int, t_s: float) -> None:
    world = World(seed, 20.0)
    before, after = world.moving(t_s), world.moving(t_s + 0.02)
    _, i, j = np.intersect1d(before.look, after.look, return_indices=True)
    vx = (after.x[j] - before.x[i]) / 0.02
    vy = (after.y[j] - before.y[i]) / 0.02
    error = np.hypot(vx - before.vx[i], vy - before.vy[i])
    # The route is sampled: where its direction steps, a fast car's place steps by centimetres.
    speed = np.hypot(before.vx[i], before.vy[i])
    assert np.all(error < 0.5 + 0.1 * speed)
    assert not len(error) or np.median(error) < 0.5


def test_nothing_stands_on_the_carriageway(world: World) -> None:
    objects = world.scenery
    across = ~np.isin(objects.kind, (Kind.RAIL, Kind.GANTRY))
    s = np.arange(len(world.route.x)) * STEP
    for i in np.flatnonzero(across)[::7]:
        near = slice(max(int(objects.s[i]) - 60, 0), int(objects.s[i]) + 60)
        gap = np.hypot(world.route.x[near] - objects.x[i], world.route.y[near] - objects.y[i])
        assert gap.min() > world.route.outer[near][gap.argmin()], (
            Kind(objects.kind[i]),
            s[near][0],
        )


def test_a_drive_meets_vehicles_houses_and_people() -> None:
    kinds = np.concatenate([World(seed, 60.0).objects(30.0).kind for seed in range(8)])
    for kind in (*VEHICLES, Kind.BUILDING, Kind.PEDESTRIAN, Kind.RAIL, Kind.TREE, Kind.SIGN):
        assert np.any(kinds == kind), kind
