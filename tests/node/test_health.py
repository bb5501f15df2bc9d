from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from node.health import Health


def running(cycle_s: float, cycles: int = 20) -> tuple[Health, float]:
    health = Health("radar", 0.0)
    now = 0.0
    for _ in range(cycles):
        now += cycle_s
        health.seen(now)
    return health, now


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
    back = health.seen(now + 20.0)
    assert back is not None
    assert back.state == "ok"
    assert health.check(now + 20.0 + cycle_s) is None or cycle_s < 0.11


def test_a_silence_does_not_teach_a_longer_cycle() -> None:
    health, now = running(0.07)
    health.check(now + 5)
    health.seen(now + 60)
    event = health.check(now + 60.5)
    assert event is not None
    assert event.state == "stale"


def test_lost_is_told_once() -> None:
    health, now = running(0.07)
    assert health.lost("can0 is down") is not None
    assert health.lost("can0 is down") is None
    assert health.check(now + 5) is None
    assert health.seen(now + 6) is not None


@given(st.floats(0.02, 1.0))
def test_a_silence_that_nobody_noticed_is_told_at_its_end_and_teaches_no_cycle(
    cycle_s: float,
) -> None:
    health, now = running(cycle_s)
    back = health.seen(now + 20.0)
    assert back is not None
    assert (back.state, back.detail) == ("ok", "back after 20.00 s")
    stale = health.check(now + 20.0 + max(3.01 * cycle_s, 0.16))
    assert stale is not None
    assert stale.state == "stale"
