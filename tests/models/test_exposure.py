from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.estimate.exposure import (
    LONGEST_GAP_S,
    MEASURES,
    TIME_CONSTANTS_S,
    UNSEEN,
    ExposureHistory,
    seen_before,
)
from models.estimate.image_features import exposure, image_features

S = 10**9
GAP_NS = round(LONGEST_GAP_S * S)

measures = st.lists(
    st.floats(-1, 8), min_size=MEASURES, max_size=MEASURES
).map(lambda values: np.array(values))  # fmt: skip
stamps = st.integers(-(2**62), 2**62)
steps = st.integers(1, GAP_NS)


@given(measures, measures, stamps, st.lists(steps, min_size=1, max_size=8))
def test_a_steady_exposure_is_approached_exactly_whatever_the_spacing(
    first: np.ndarray, then: np.ndarray, start_ns: int, spacing: list[int]
) -> None:
    history, stamp_ns = ExposureHistory.begin(start_ns, first), start_ns
    for step_ns in spacing:
        stamp_ns += step_ns
        history = history.after(stamp_ns, then)
    left = np.exp(-(sum(spacing) * 1e-9) / np.array(TIME_CONSTANTS_S))[:, np.newaxis]
    np.testing.assert_allclose(history.averages, then + left * (first - then), atol=1e-12)
    assert (history.began_ns, history.stamp_ns) == (start_ns, stamp_ns)


@given(measures, measures, stamps, st.integers(2, GAP_NS), st.floats(0.01, 0.99))
def test_a_step_in_two_gives_what_it_gives_in_one(
    first: np.ndarray, then: np.ndarray, start_ns: int, step_ns: int, share: float
) -> None:
    history = ExposureHistory.begin(start_ns, first)
    part_ns = max(1, int(share * step_ns))
    once = history.after(start_ns + step_ns, then)
    twice = history.after(start_ns + part_ns, then).after(start_ns + step_ns, then)
    np.testing.assert_allclose(twice.averages, once.averages, atol=1e-12)


@given(measures, measures, measures, stamps, st.integers(1, 2 * GAP_NS))
def test_what_is_seen_is_finite_and_zero_without_a_history(
    first: np.ndarray, then: np.ndarray, now: np.ndarray, start_ns: int, step_ns: int
) -> None:
    history = ExposureHistory.begin(start_ns, first).after(start_ns + 1, then)
    seen = seen_before(history, start_ns + 1 + step_ns, now)
    assert np.isfinite(seen).all()
    assert (seen[0] == 1) == (step_ns <= GAP_NS)
    if step_ns > GAP_NS:
        assert np.array_equal(seen, UNSEEN)


@given(measures, measures, stamps, st.integers(0, GAP_NS))
def test_a_frame_that_is_not_newer_sees_nothing_and_changes_nothing(
    first: np.ndarray, late: np.ndarray, start_ns: int, by_ns: int
) -> None:
    history = ExposureHistory.begin(start_ns, first)
    assert history.after(start_ns - by_ns, late) is history
    assert np.array_equal(seen_before(history, start_ns - by_ns, late), UNSEEN)


@pytest.mark.parametrize("away_s", [3600.0, -3600.0, 2.1, -2.1])
def test_after_a_silence_or_a_clock_set_back_it_begins_anew(away_s: float) -> None:
    rng = np.random.default_rng(0)
    first, then, now = rng.uniform(0, 8, (3, MEASURES))
    used = ExposureHistory.begin(0, first).after(S, first)
    stamp_ns = S + round(away_s * S)
    assert np.array_equal(seen_before(used, stamp_ns, then), UNSEEN)
    used = used.after(stamp_ns, then)
    fresh = ExposureHistory.begin(stamp_ns, then)
    assert np.array_equal(
        seen_before(used, stamp_ns + 1, now), seen_before(fresh, stamp_ns + 1, now)
    )


def test_the_first_frame_has_seen_nothing() -> None:
    assert np.array_equal(seen_before(None, 5, np.ones(MEASURES)), UNSEEN)
    assert not UNSEEN.any()


def test_a_camera_that_stands_still_sees_no_change() -> None:
    still = np.arange(MEASURES) / 2
    history = ExposureHistory.begin(0, still)
    for stamp_ns in range(S // 20, 3 * S, S // 20):
        history = history.after(stamp_ns, still)
    changes = seen_before(history, 3 * S, still)[-len(TIME_CONSTANTS_S) * MEASURES :]
    np.testing.assert_allclose(changes, 0, atol=1e-12)


def test_twice_the_light_is_one_stop_and_the_ends_are_shares() -> None:
    dim = np.random.default_rng(0).integers(20, 80, (300, 400, 3), np.uint8)
    dark, bright = (exposure(image_features(image)) for image in (dim, 2 * dim))
    np.testing.assert_allclose(bright[:5] - dark[:5], 1, atol=0.02)
    assert not dark[5:].any()
    for value, shares in ((0, (1, 0)), (1, (1, 0)), (254, (0, 1)), (255, (0, 1)), (9, (0, 0))):
        even = exposure(image_features(np.full((90, 160, 3), value, np.uint8)))
        np.testing.assert_allclose(even[5:], shares, atol=1e-6)
    assert all(low <= high for low, high in pairwise(dark[:5]))
