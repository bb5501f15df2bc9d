"""Filter rates: steadiness, reaction and lag are told apart, and rates move them as they should."""

from __future__ import annotations

import numpy as np
import pytest

from models.estimate.filter import LevelFilter
from models.estimate.level import LEVELS
from models.evaluate.filter_rates import (
    MEASURES,
    LevelTrack,
    errors,
    filter_results,
    honesty,
    truths,
)
from models.evaluate.report import Picture, Point, Table

COUNT = 100
STAMPS_NS = np.arange(COUNT, dtype=np.int64) * 100_000_000


def _track(levels: np.ndarray, *, blur: float, seed: int = 0) -> LevelTrack:
    """Return answers around the true level: a bell ``blur`` points wide, as far off at random."""
    centres = levels + np.random.default_rng(seed).normal(0.0, blur, levels.shape)
    bells = np.exp(-(((LEVELS - centres[:, np.newaxis]) / blur) ** 2) / 2) + 1e-6
    return LevelTrack(STAMPS_NS, levels, bells / bells.sum(axis=1, keepdims=True))


def _tracks(blur: float) -> list[LevelTrack]:
    return [_track(levels, blur=blur, seed=seed) for seed, levels in enumerate(truths(COUNT))]


def test_answers_that_are_certain_have_no_error_with_a_filter_that_lets_the_level_go() -> None:
    up, down, _ = (
        LevelTrack(STAMPS_NS, levels, np.eye(11)[np.rint(levels / 10).astype(int)])
        for levels in truths(COUNT)
    )
    at_rest, after_step, ramp = errors([up, down], lambda: LevelFilter(1.0, 1.0))
    assert (at_rest, after_step) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert np.isnan(ramp)


def test_a_filter_that_never_moves_misses_the_step_and_the_ramp() -> None:
    still = errors(_tracks(15.0), lambda: LevelFilter(1e-9, 1e-9))
    moving = errors(_tracks(15.0), lambda: LevelFilter(0.3, 0.3))
    assert still[1] > 2 * moving[1]
    assert still[2] > 2 * moving[2]


def test_a_filter_that_moves_at_once_is_less_steady() -> None:
    restless = errors(_tracks(15.0), lambda: LevelFilter(100.0, 100.0))
    steady = errors(_tracks(15.0), lambda: LevelFilter(0.03, 0.03))
    assert restless[0] > 2 * steady[0]


def test_a_level_that_never_changes_is_at_rest_throughout() -> None:
    track = _track(np.full(COUNT, 30.0), blur=5.0)
    at_rest, after_step, ramp = errors([track], lambda: LevelFilter(0.1, 0.1))
    assert at_rest < 5.0
    assert np.isnan(after_step)
    assert np.isnan(ramp)


def test_the_same_answer_again_makes_a_filter_surer_unless_its_errors_stay_alike() -> None:
    wrong = np.exp(-(((LEVELS - 50.0) / 15.0) ** 2) / 2)
    track = LevelTrack(STAMPS_NS, np.full(COUNT, 30.0), np.tile(wrong / wrong.sum(), (COUNT, 1)))
    sure, far, surprised = honesty([track], lambda: LevelFilter(0.1, 0.1))
    unsure, near, calm = honesty([track], lambda: LevelFilter(0.1, 0.1, 1.0))
    assert sure < unsure
    assert far > near
    assert surprised > calm


def test_results_hold_the_default_once_a_rate_and_a_picture() -> None:
    shipped = LevelFilter(0.2, 0.3)
    *points, picture, table = filter_results("radar", _tracks(15.0), shipped, update_us=30.0)
    assert isinstance(picture, Picture)
    assert isinstance(table, Table)
    assert [row[0] for row in table.rows if "default" in str(row[0])] == ["0 s (default)"]
    *_, of_shared = filter_results("radar", _tracks(15.0), LevelFilter(0.2, 0.3, 0.0, 0.6), 30.0)
    assert isinstance(of_shared, Table)
    assert of_shared.columns[0] == "shared"
    assert [row[0] for row in of_shared.rows if "default" in str(row[0])] == ["0.6 (default)"]
    defaults = [point for point in points if isinstance(point, Point) and "default" in point.knob]
    assert [point.knob.split("=")[0] for point in defaults] == ["drift"] * 3 + ["jump"] * 3
    by_measure = {
        measure: {point.error for point in defaults if point.variant.endswith(measure)}
        for measure in MEASURES
    }
    assert all(len(errors) == 1 for errors in by_measure.values())
