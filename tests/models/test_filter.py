"""The level filter against its law, in stiff cases and against mpmath."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc.errors import InputError
from models.estimate.filter import SHARED_S, LevelFilter, transition

SECOND = 1_000_000_000
WEEK = 7 * 24 * 3600 * SECOND
RATES = st.floats(-6.0, 6.0).map(lambda power: 10.0**power)
SPACINGS = st.floats(0.0, np.log10(WEEK)).map(lambda power: round(10.0**power))


def certain(level: int) -> np.ndarray:
    return np.eye(11)[level]


def reference_generator(drift: float, jump: float) -> mp.matrix:
    """Q of the chain, straight from its definition."""
    Q = mp.matrix(11, 11)
    for i in range(11):
        for j in range(11):
            if i != j:
                Q[i, j] = mp.mpf(jump) / 11 + (mp.mpf(drift) if abs(i - j) == 1 else 0)
    for i in range(11):
        Q[i, i] = -mp.fsum(Q[i, j] for j in range(11) if j != i)
    return Q


def reference_transition(drift: float, jump: float) -> mp.matrix:
    """exp(Q) at 60 digits, by eigenvectors so that 1e12 steps are as exact as one."""
    values, vectors = mp.eigsy(reference_generator(drift, jump))
    return vectors * mp.diag([mp.exp(value) for value in values]) * vectors.T


def as_array(matrix: mp.matrix) -> np.ndarray:
    return np.array(matrix.tolist(), dtype=object)


@pytest.mark.parametrize("drift", [1e-15, 1e-6, 0.01, 1.0, 29.9, 30.1, 1e3, 6.048e11])
@pytest.mark.parametrize("jump", [0.0, 1e-15, 1.0, 6.048e11])
def test_transition_equals_the_exponential_of_the_generator(drift: float, jump: float) -> None:
    moves = transition(drift, jump)
    with mp.workdps(220):  # the smallest entry is 1e-157 of the largest
        expected = as_array(reference_transition(drift, jump))
        relative = [abs(a / e - 1) for a, e in zip(moves.flat, expected.flat, strict=True)]
        assert max(relative) < 1e-12
    assert np.all(moves >= 0.0)
    np.testing.assert_allclose(moves.sum(axis=1), 1.0, rtol=0, atol=1e-13)


@settings(max_examples=100, deadline=None)
@given(a=RATES, b=RATES, share=st.floats(0.0, 1.0))
def test_two_intervals_in_a_row_are_one(a: float, b: float, share: float) -> None:
    halves = transition(a * share, b * share) @ transition(a * (1 - share), b * (1 - share))
    np.testing.assert_allclose(halves, transition(a, b), atol=1e-9)


@settings(max_examples=100, deadline=None)
@given(
    drift=RATES,
    jump=RATES,
    measurements=st.lists(st.tuples(SPACINGS, st.integers(0, 10)), min_size=1, max_size=20),
    ahead=SPACINGS,
)
def test_stays_a_distribution_at_any_rate_and_spacing(
    drift: float, jump: float, measurements: list[tuple[int, int]], ahead: int
) -> None:
    level_filter = LevelFilter(drift, jump)
    stamp = 0
    for spacing, level in measurements:
        stamp += spacing
        filtered = level_filter.update(stamp, certain(level))
        assert np.all(filtered >= 0.0)
        assert abs(filtered.sum() - 1.0) < 1e-12
        assert filtered[level] == pytest.approx(1.0)
    predicted = level_filter.predict(stamp + ahead)
    assert np.all(predicted >= 0.0)
    assert abs(predicted.sum() - 1.0) < 1e-12


@pytest.mark.parametrize(
    ("drift", "jump", "spacing"),
    [(1e-6, 1e-6, 1), (1e6, 1e6, WEEK), (1e-6, 0.0, 1), (0.0, 1e6, 1), (0.3, 0.1, 70_000_000)],
)
def test_equals_mpmath_after_a_thousand_contradictory_measurements(
    drift: float, jump: float, spacing: int
) -> None:
    rng = np.random.default_rng(1)
    sure = np.full(11, 1e-300)
    level_filter = LevelFilter(drift, jump)
    with mp.workdps(60):
        dt = mp.mpf(spacing) / SECOND
        moves = reference_transition(drift * dt, jump * dt)
        state = mp.matrix([mp.mpf(1) / 11] * 11)
        for step in range(1000):
            measured = sure.copy()
            measured[[0, 10][step % 2]] = 1.0
            if step >= 990:  # then soft ones, so that every level keeps digits to compare
                measured = rng.dirichlet(np.ones(11))
            filtered = level_filter.update(step * spacing, measured)
            if step:
                state = moves * state
            state = mp.matrix([p * mp.mpf(float(m)) for p, m in zip(state, measured, strict=True)])
            state /= mp.fsum(state)
            assert abs(filtered.sum() - 1.0) < 1e-12
        expected = np.array([float(p) for p in state])
    np.testing.assert_allclose(filtered, expected, rtol=1e-9, atol=1e-14)


def test_prediction_widens_to_uniform() -> None:
    level_filter = LevelFilter(0.5, 0.01)
    level_filter.update(0, certain(3))
    deviations = []
    for seconds in (0, 1, 10, 100, 10_000):
        predicted = level_filter.predict(seconds * SECOND)
        deviations.append(float(predicted.max()))
    assert deviations == sorted(deviations, reverse=True)
    np.testing.assert_allclose(predicted, 1 / 11, atol=1e-12)


def test_prediction_does_not_change_the_state() -> None:
    asked, unasked = LevelFilter(0.5, 0.1), LevelFilter(0.5, 0.1)
    for level_filter in (asked, unasked):
        level_filter.update(0, certain(3))
    asked.predict(50 * SECOND)
    measured = np.linspace(0.1, 1.0, 11)
    np.testing.assert_array_equal(asked.update(SECOND, measured), unasked.update(SECOND, measured))


def test_late_measurement_is_counted_and_ignored() -> None:
    level_filter = LevelFilter(0.5, 0.1)
    before = level_filter.update(5 * SECOND, np.linspace(0.1, 1.0, 11))
    after = level_filter.update(4 * SECOND, certain(0))
    np.testing.assert_array_equal(after, before)
    assert level_filter.late == 1


def test_jump_follows_a_tunnel_faster_than_drift_alone() -> None:
    def after_step(jump: float) -> float:
        level_filter = LevelFilter(0.05, jump)
        for step in range(40):
            measured = 0.02 + certain(0 if step < 37 else 8)
            filtered = level_filter.update(step * SECOND // 14, measured)
        return float(filtered[8])

    assert after_step(0.05) > 0.9 > after_step(0.0)


def test_impossible_but_certain_measurement_stands() -> None:
    level_filter = LevelFilter(0.0, 0.0)
    level_filter.update(0, certain(0))
    np.testing.assert_array_equal(level_filter.update(SECOND, certain(10)), certain(10))


def test_correlated_measurements_count_by_elapsed_time_not_by_number() -> None:
    measured = np.linspace(1.0, 2.0, 11)
    once, often = LevelFilter(0.0, 0.0, 2.0), LevelFilter(0.0, 0.0, 2.0)
    once.update(0, measured)
    for stamp in np.linspace(0, SECOND // 100, 1000, dtype=int):
        filtered = often.update(int(stamp), measured)
    np.testing.assert_allclose(filtered, once.predict(SECOND), rtol=0.01)
    assert LevelFilter(0.0, 0.0, 2.0).update(0, measured)[10] < filtered[10]


@pytest.mark.parametrize("spacing_s", [0.01, 0.07, 0.5, SHARED_S])
def test_measurements_that_share_data_count_by_their_number(spacing_s: float) -> None:
    """The second to fifth say half of what they would alone: three measurements in all."""
    measured = np.linspace(1.0, 2.0, 11)
    levels = LevelFilter(0.0, 0.0, shared=0.5)
    for number in range(5):
        filtered = levels.update(round(number * spacing_s * SECOND), measured)
    np.testing.assert_allclose(filtered, measured**3 / (measured**3).sum(), rtol=1e-9)


def test_measurements_far_apart_share_nothing() -> None:
    measured = np.linspace(1.0, 2.0, 11)
    levels = LevelFilter(0.0, 0.0, shared=0.5)
    levels.update(0, measured)
    filtered = levels.update(round(1.1 * SHARED_S * SECOND), measured)
    np.testing.assert_allclose(filtered, measured**2 / (measured**2).sum(), rtol=1e-9)


@pytest.mark.parametrize(
    "rates", [(-1.0, 0.0, 0.0), (0.0, np.nan, 0.0), (0.0, 0.0, np.inf), (0.0, 0.0, 0.0, -0.1)]
)
def test_impossible_rates_are_refused(rates: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="expected a finite number"):
        LevelFilter(*rates)


def test_more_than_everything_cannot_be_shared() -> None:
    with pytest.raises(InputError, match="expected 0 to 1"):
        LevelFilter(0.0, 0.0, shared=1.1)


@pytest.mark.parametrize(
    "measured", [np.zeros(11), np.ones(10), np.full(11, np.nan), np.array([-1.0] + [1.0] * 10)]
)
def test_impossible_measurements_are_refused(measured: np.ndarray) -> None:
    level_filter = LevelFilter(0.1, 0.1)
    with pytest.raises(InputError):
        level_filter.update(0, measured)
    np.testing.assert_allclose(level_filter.predict(0), 1 / 11)
