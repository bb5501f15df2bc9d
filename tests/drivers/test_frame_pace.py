from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drivers.frame_pace import FramePace

PERIOD = 33_333_333


GAPS_AND_ONE_FRAME_WITHOUT = st.tuples(st.integers(0, 200), st.integers(0, 200), st.just(0))


@given(
    blocks=st.lists(GAPS_AND_ONE_FRAME_WITHOUT, min_size=1, max_size=20),
    jitter=st.floats(0, 0.05),
    seed=st.integers(0, 2**32 - 1),
)
def test_gaps_at_the_nominal_pace_are_counted_exactly(
    blocks: list[tuple[int, int, int]], jitter: float, seed: int
) -> None:
    gaps = [gap for block in blocks for gap in block]
    places = np.cumsum([0, *(gap + 1 for gap in gaps)])
    noise = np.random.default_rng(seed).uniform(-jitter, jitter, len(places))
    stamps = [round((place + shift) * PERIOD) for place, shift in zip(places, noise, strict=True)]
    pace = FramePace(PERIOD)
    assert [pace.missing_before(stamp) for stamp in stamps] == [0, *gaps]


def test_half_of_the_frames_may_be_missing() -> None:
    kept = np.flatnonzero(np.random.default_rng(3).random(400) < 0.5)
    pace = FramePace(PERIOD)
    counted = sum(pace.missing_before(int(place) * PERIOD) for place in kept)
    assert counted == kept[-1] - kept[0] + 1 - len(kept)


def test_a_slow_camera_is_soon_believed_to_be_slow_and_then_loses_nothing() -> None:
    pace = FramePace(PERIOD)
    counted = [pace.missing_before(2 * PERIOD * index) for index in range(50)]
    assert sum(counted) <= 4
    assert pace.interval_ns == 2 * PERIOD
    assert pace.missing_before(2 * PERIOD * 53) == 3


def test_a_camera_that_grows_slow_and_fast_again_is_followed() -> None:
    pace, stamp = FramePace(PERIOD), 0
    for interval in [PERIOD] * 30 + [2 * PERIOD] * 30 + [PERIOD] * 30:
        stamp += interval
        pace.missing_before(stamp)
    assert pace.interval_ns == PERIOD
    assert pace.missing_before(stamp + 3 * PERIOD) == 2


def test_stamps_that_repeat_or_go_back_miss_nothing() -> None:
    pace = FramePace(PERIOD)
    assert [pace.missing_before(stamp) for stamp in (10 * PERIOD, 10 * PERIOD, PERIOD)] == [0] * 3
    assert pace.missing_before(4 * PERIOD) == 2
