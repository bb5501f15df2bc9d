from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from node.health import Health


def running(cycle_s: float, cycles: int = 20) -> tuple[Health, float]:
    health = Health("radar", 0.0)
    now = 0.0
    for _ in range(cycles):
        now += cycle_s
        health.seen(now, stamp_ns(now))
    return health, now


def stamp_ns(now_s: float) -> int:
    return 1_700_000_000_000_000_000 + round(now_s * 1e9)


def test_never_seen_is_not_stale() -> None:
    health = Health("radar", 0.0)
    assert health.check(0.5) is None
    event = health.check(1.5)
    assert event is not None
    assert event.state == "never_seen"
    assert health.check(100.0) is None


@given(st.floats(0.02, 1.0))
def test_three_silent_cycles_make_it_stale_once_and_a_message_brings_it_back(
    cycle_s: float,
) -> None:
    health, now = running(cycle_s)
    assert health.check(now + 1.5 * cycle_s) is None or cycle_s < 0.11
    event = health.check(now + max(3.01 * cycle_s, 0.16))
    assert event is not None
    assert event.state == "stale"
    assert health.check(now + 10.0) is None
    back = health.seen(now + 20.0, stamp_ns(now + 20.0))
    assert back is not None
    assert back.state == "ok"
    assert health.check(now + 20.0 + cycle_s) is None or cycle_s < 0.11


def test_a_silence_does_not_teach_a_longer_cycle() -> None:
    health, now = running(0.07)
    health.check(now + 5)
    health.seen(now + 60, stamp_ns(now + 60))
    event = health.check(now + 60.5)
    assert event is not None
    assert event.state == "stale"


def test_lost_is_told_once() -> None:
    health, now = running(0.07)
    assert health.lost("can0 is down") is not None
    assert health.lost("can0 is down") is None
    assert health.check(now + 5) is None
    assert health.seen(now + 6, stamp_ns(now + 6)) is not None


@given(st.floats(0.02, 1.0))
def test_a_silence_that_nobody_noticed_is_told_at_its_end_and_teaches_hardly_a_cycle(
    cycle_s: float,
) -> None:
    health, now = running(cycle_s)
    back = health.seen(now + 20.0, stamp_ns(now + 20.0))
    assert back is not None
    assert (back.state, back.detail) == ("ok", "back after 20.00 s")
    stale = health.check(now + 20.0 + max(3.7 * cycle_s, 0.16))
    assert stale is not None
    assert stale.state == "stale"


def test_messages_that_are_read_late_and_at_once_teach_when_they_came() -> None:
    health, now = running(0.2)
    for number in range(1, 11):
        health.seen(now + 2.0, stamp_ns(now + 0.2 * number))
    assert health.check(now + 2.5) is None
    stale = health.check(now + 2.7)
    assert stale is not None
    assert stale.detail == "silent for 0.70 s, its cycle is 200 ms"


def test_a_sensor_that_slows_down_is_soon_no_longer_silent() -> None:
    health, now = running(0.05)
    later = [now + 0.5 * number for number in range(1, 40)]
    events = [health.seen(then, stamp_ns(then)) for then in later]
    assert events[0] is not None
    assert events[20:] == [None] * 19


def test_a_clock_that_was_set_back_is_told() -> None:
    health = Health("radar", 0.0)
    for n in range(5):
        health.seen(0.07 * n, 10**12 + 70_000_000 * n)
    told = health.seen(0.35, 10**12 - 3600 * 10**9)
    assert told is not None
    assert told.state == "ok"
    assert "set back by 3600" in told.detail
    assert health.seen(0.42, 10**12 - 3600 * 10**9 + 70_000_000) is None
