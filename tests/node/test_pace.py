"""Time in a run: it follows the stamps, and goes on where a clock was set."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from node.pace import Pace

S = 10**9


@given(st.integers(0, 2**62), st.lists(st.integers(0, 3600 * S), max_size=20))
def test_time_is_the_distance_from_the_first_stamp(first: int, steps: list[int]) -> None:
    pace, stamp = Pace(None), first
    assert pace.since_start_ns(first) == 0
    for step in steps:
        stamp += step
        assert pace.since_start_ns(stamp) == stamp - first


@given(st.booleans(), st.integers(2 * S, 10**18), st.integers(0, S))
def test_time_goes_on_where_the_clock_was_set_back(live: bool, back: int, step: int) -> None:
    pace = Pace(None, live=live)
    pace.since_start_ns(10**18)
    before = pace.since_start_ns(10**18 + S)
    assert pace.since_start_ns(10**18 + S - back) == before
    assert pace.since_start_ns(10**18 + S - back + step) == before + step


def test_a_late_message_is_no_clock_that_was_set() -> None:
    pace = Pace(None)
    pace.since_start_ns(0)
    pace.since_start_ns(10 * S)
    assert pace.since_start_ns(9 * S + S // 2) == 9 * S + S // 2


def test_a_live_clock_set_forward_is_told_from_a_gap_in_a_recording() -> None:
    year_ns = 365 * 86400 * S
    live, recorded = Pace(None, live=True), Pace(None)
    for pace, after in ((live, S), (recorded, year_ns)):
        pace.since_start_ns(0)
        pace.since_start_ns(S)
        assert pace.since_start_ns(S + year_ns) == after + (pace is recorded) * S
