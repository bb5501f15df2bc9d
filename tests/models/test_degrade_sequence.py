from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dbc.errors import InputError
from models.degrade import radar
from models.degrade.draw import DrawKey
from models.degrade.sequence import Burst, Constant, Ramp, RandomWalk, Step

POINTS = ((1.0, 20.0), (3.0, 60.0), (3.0, 10.0), (5.0, 30.0))
EVERY = [
    Constant(40.0),
    Step(POINTS),
    Ramp(POINTS),
    Burst(80.0, 0.5, 2.0, 10.0),
    RandomWalk(1, 50.0, 20.0),
    RandomWalk(2, 30.0, 1e6, 20.0, 35.0),
]


@pytest.mark.parametrize("schedule", EVERY, ids=lambda schedule: type(schedule).__name__)
@pytest.mark.parametrize("t_s", [-1.0, 0.0, 1e-9, 0.1, 3.0, 3600.0, 86400.0, 1e12])
def test_levels_are_levels_at_any_time(schedule, t_s):
    level = schedule.level_at(t_s)
    assert 0 <= level <= 100
    assert schedule.level_at(t_s) == level
    if t_s < 0:
        assert level == schedule.level_at(0.0)
    with pytest.raises(InputError, match="no time"):
        schedule.level_at(math.nan)


def test_steps_and_ramps_pass_through_their_points():
    times = [0, 1, 2, 3, 4, 5, 9]
    assert [Step(POINTS).level_at(t) for t in times] == [0, 20, 20, 10, 10, 30, 30]
    assert [Ramp(POINTS).level_at(t) for t in times] == [0, 20, 40, 10, 20, 30, 30]


def test_bursts_repeat():
    burst = Burst(80.0, 0.5, 2.0, 10.0)
    assert [burst.level_at(t) for t in (0, 0.49, 0.5, 1.9, 2.0, 2.6)] == [80, 80, 10, 10, 80, 10]


@pytest.mark.parametrize(
    "make",
    [
        lambda: Constant(101.0),
        lambda: Constant(math.nan),
        lambda: Step(()),
        lambda: Ramp(((2.0, 1.0), (1.0, 1.0))),
        lambda: Ramp(((math.nan, 1.0),)),
        lambda: Burst(10.0, 3.0, 2.0),
        lambda: Burst(10.0, 0.0, 0.0),
        lambda: RandomWalk(1, 50.0, -1.0),
        lambda: RandomWalk(1, 50.0, 1.0, 60.0, 70.0),
        lambda: RandomWalk(1, 50.0, 1.0, 70.0, 60.0),
    ],
)
def test_impossible_schedules_are_refused(make):
    with pytest.raises(InputError):
        make()


@pytest.mark.parametrize("step", [1e-9, 1e-3, 1.0, 7.3, 86400.0])
def test_the_walks_increments_are_normal_with_variance_proportional_to_time(step):
    """At any time step: 1,500 seeds, standard deviation within 4 standard errors."""
    start = 3.7
    increments = np.array(
        [walk._brownian(start + step) - walk._brownian(start) for walk in walks(1500)]
    )
    scale = math.sqrt(step)
    assert abs(increments.mean()) < 4 * scale / math.sqrt(1500)
    assert increments.std() == pytest.approx(scale, rel=4 / math.sqrt(3000) + 0.02)


def walks(count):
    return [RandomWalk(seed, 50.0, 1.0) for seed in range(count)]


def test_the_walks_increments_are_independent():
    before, after = np.array(
        [(w._brownian(5.3), w._brownian(9.1) - w._brownian(5.3)) for w in walks(1500)]
    ).T
    assert abs(np.corrcoef(before, after)[0, 1]) < 4 / math.sqrt(1500)


def test_a_reflected_walk_fills_its_bounds_evenly():
    levels = np.array(
        [RandomWalk(seed, 25.0, 20.0, 20.0, 40.0).level_at(60.0) for seed in range(800)]
    )
    even = np.abs(np.sort(levels) - np.linspace(20, 40, 800)).max() / 20
    assert even < 1.95 / math.sqrt(800)


@given(st.floats(0, 1e5), st.floats(0, 1e5))
def test_the_walk_does_not_depend_on_when_it_is_looked_at(one, other):
    walk, fresh = RandomWalk(9, 50.0, 3.0), RandomWalk(9, 50.0, 3.0)
    expected = fresh.level_at(one)
    walk.level_at(other)
    assert walk.level_at(one) == expected


def test_ghosts_live_as_long_as_they_are_told():
    lives = [
        radar.draw("ghosts", 50, DrawKey(1, "radar", k), ghost_life=10).ghosts for k in range(100)
    ]
    assert all(len(set(lives[k : k + 10])) == 1 for k in range(0, 100, 10))
    assert len(set(lives)) > 5
    key = DrawKey(1, "radar", 25)
    assert radar.draw("ghosts", 50, key, ghost_life=1e1) == radar.draw(
        "ghosts", 50, key, ghost_life=10
    )
    with pytest.raises(InputError, match="ghost_life"):
        radar.draw("ghosts", 50, DrawKey(1, "radar", 0), ghost_life=0)
