from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from models.bev.ospa import CUTOFF_M, assign, ospa
from models.bev.truth import Truth
from models.world.objects import Floats

NOTHING = np.empty((0, 5))


def truth(*places: tuple[float, float], ignored: Floats = NOTHING) -> Truth:
    return Truth(np.array(places).reshape(-1, 2), ignored)


def detections(*places: tuple[float, float]) -> Floats:
    return np.array(places).reshape(-1, 2)


@given(st.integers(0, 9), st.integers(0, 9), st.integers(0, 2**32 - 1), st.booleans())
def test_no_assignment_costs_less(n: int, m: int, seed: int, ties: bool) -> None:
    cost = np.random.default_rng(seed).uniform(0, 5, (n, m))
    cost = np.round(cost) if ties else cost
    rows, columns = assign(cost)
    assert len(rows) == len(set(columns.tolist())) == len(set(rows.tolist())) == min(n, m)
    best = linear_sum_assignment(cost)
    np.testing.assert_allclose(cost[rows, columns].sum(), cost[best].sum(), atol=1e-9)


def test_what_is_right_costs_nothing() -> None:
    places = ((10.0, 1.0), (30.0, -2.0))
    assert ospa(detections(*places), truth(*places)) == 0
    assert ospa(detections(), truth()) == 0


def test_offsets_misses_and_false_alarms_in_metres() -> None:
    two = truth((10.0, 0.0), (30.0, 0.0))
    assert ospa(detections((11.0, 0.0), (30.0, 2.0)), two) == 1.5
    assert ospa(detections((11.0, 0.0)), two) == (1 + CUTOFF_M) / 2
    assert ospa(detections(), two) == CUTOFF_M
    assert ospa(detections((20.0, 0.0)), truth()) == CUTOFF_M
    assert ospa(detections((10.0, 0.0), (30.0, 0.0), (20.0, 0.0)), two) == CUTOFF_M / 3


def test_nothing_counts_more_than_the_cutoff() -> None:
    assert ospa(detections((50.0, 0.0)), truth((10.0, 0.0))) == CUTOFF_M


def test_what_is_ignored_is_neither_right_nor_wrong() -> None:
    parked = np.array([[20.0, 4.0, np.pi / 2, 2.0, 4.5]])
    one = truth((10.0, 0.0), ignored=parked)
    found = (10.0, 0.0)
    assert ospa(detections(found, (20.0, 4.0), (22.0, 4.0)), one) == 0
    assert ospa(detections(found, (25.0, 4.0)), one) == CUTOFF_M / 2
    assert ospa(detections(found, (10.0, 30.0), (2.0, 0.0)), one) == 0  # nothing is asked there


@given(
    st.lists(st.tuples(st.floats(5, 50), st.floats(-2, 2)), max_size=6),
    st.lists(st.tuples(st.floats(5, 50), st.floats(-2, 2)), max_size=6),
)
def test_it_is_symmetric_and_bounded(
    one: list[tuple[float, float]], other: list[tuple[float, float]]
) -> None:
    there = ospa(detections(*one), truth(*other))
    assert 0 <= there <= CUTOFF_M
    np.testing.assert_allclose(there, ospa(detections(*other), truth(*one)), atol=1e-9)
