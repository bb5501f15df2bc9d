from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from node.chooser import Chooser
from node.events import ModelChoice
from tests.node.switching import SECOND, noise_level, switch

TENTH = SECOND // 10

Step = tuple[str | None, float, int]
"""Sensor (None: nothing came), level in %, and nanoseconds since the step before."""

STEPS = st.lists(
    st.tuples(
        st.sampled_from(["camera", "radar", None]),
        st.floats(0, 100),
        st.integers(0, SECOND),
    ),
    max_size=60,
)


def play(chooser: Chooser, steps: Sequence[Step]) -> list[tuple[int, ModelChoice]]:
    now_ns, choices = 0, []
    for sensor, level, passed_ns in steps:
        now_ns += passed_ns
        given_level = None if sensor is None else noise_level(sensor, level, now_ns)
        choice = chooser.update(given_level, now_ns)
        if choice is not None:
            choices.append((now_ns, choice))
    return choices


def both(camera: float, radar: float = 0.0, times: int = 1) -> list[Step]:
    return [("camera", camera, TENTH), ("radar", radar, 0)] * times


@given(STEPS, st.floats(0, 3))
def test_dwell_is_kept_but_for_silence(steps: list[Step], dwell_s: float) -> None:
    choices = play(Chooser(switch(dwell_s)), steps)
    changes = choices[1:]
    for (before_ns, _), (now_ns, choice) in itertools.pairwise(changes):
        assert now_ns - before_ns >= dwell_s * SECOND or "stale" in choice.reason


@given(STEPS, st.floats(0, 3))
def test_each_choice_begins_where_the_last_ended_and_is_another(
    steps: list[Step], dwell_s: float
) -> None:
    chooser = Chooser(switch(dwell_s))
    choices = [choice for _, choice in play(chooser, steps)]
    models = [choice.model for choice in choices]
    assert [choice.previous for choice in choices] == ["", *models[:-1]][: len(choices)]
    assert all(a != b for a, b in itertools.pairwise(models))
    assert chooser.model == (models[-1] if models else "both")
    assert all(choice.reason for choice in choices)


@given(st.lists(st.floats(30.5, 39.5), max_size=40), st.booleans())
def test_within_the_hysteresis_nothing_changes(levels: list[float], from_above: bool) -> None:
    chooser = Chooser(switch(dwell_s=0))
    before = play(chooser, both(90.0 if from_above else 0.0))
    after = play(chooser, [step for level in levels for step in both(level)])
    assert before[-1][1].model == ("radar_only" if from_above else "both")
    assert after == []


@given(STEPS)
def test_the_first_rule_that_holds_decides(steps: list[Step]) -> None:
    chooser = Chooser(switch(dwell_s=0))
    held_camera = held_radar = False
    last_ns: dict[str, int] = {}
    now_ns = 0
    for sensor, level, passed_ns in steps:
        now_ns += passed_ns
        chooser.update(None if sensor is None else noise_level(sensor, level), now_ns)
        for name in ("camera", "radar"):
            last_ns.setdefault(name, now_ns)
        if sensor is not None:
            last_ns[sensor] = now_ns
        stale = {name for name, at_ns in last_ns.items() if (now_ns - at_ns) * 1e-9 > 0.5}
        if sensor == "camera":
            held_camera = level >= (30 if held_camera else 40)
        if sensor == "radar":
            held_radar = level >= (40 if held_radar else 60)
        held_camera &= "camera" not in stale
        held_radar &= "radar" not in stale
        expected = (
            "radar_only" if "camera" in stale
            else "camera_only" if "radar" in stale
            else "radar_only" if held_camera
            else "camera_only" if held_radar
            else "both"
        )  # fmt: skip
        assert chooser.model == expected


def test_silence_is_not_waited_for_and_recovery_is() -> None:
    ((at_ns, choice),) = play(Chooser(switch(5.0)), [*both(0), *[("radar", 0.0, TENTH)] * 7])[1:]
    assert choice.model == "radar_only"
    assert at_ns == 7 * TENTH  # camera heard at 1, allowed 5 more
    assert "camera is stale: 0.60 s without a level" in choice.reason


def test_silence_does_not_wait_for_the_dwell_of_the_change_before() -> None:
    radar_ends: list[Step] = [("camera", 90.0, TENTH)] * 7
    choices = play(Chooser(switch(dwell_s=60.0)), [*both(0), *both(90), *radar_ends])
    assert [choice.model for _, choice in choices] == ["both", "radar_only", "camera_only"]


def test_back_from_silence_only_after_the_dwell() -> None:
    chooser = Chooser(switch(dwell_s=2.0))
    gone = [*both(0), *[("radar", 0.0, TENTH)] * 7]
    choices = play(chooser, [*gone, *both(0, times=40)])
    assert [choice.model for _, choice in choices] == ["both", "radar_only", "both"]
    assert choices[2][0] - choices[1][0] == 2 * SECOND


def test_a_sensor_that_never_speaks_is_stale_too() -> None:
    choices = play(Chooser(switch()), [(None, 0, TENTH)] * 8)
    assert [choice.model for _, choice in choices] == ["both", "radar_only"]
    assert choices[0][1].reason == "no rule holds: no level yet"


def test_the_last_level_of_a_stale_sensor_says_nothing_any_more() -> None:
    rules = [
        {"sensor": "camera", "above": 40, "hysteresis": 10, "model": "radar_only"},
        {"sensor": "camera", "stale_s": 0.5, "model": "stop"},
    ]
    choices = play(Chooser(switch(0, rules)), [("camera", 90, 0), *[(None, 0, TENTH)] * 7])
    assert [choice.model for _, choice in choices] == ["radar_only", "stop"]


def test_what_is_no_level_counts_as_silence() -> None:
    bad: list[Step] = [("camera", value, TENTH) for value in [float("nan"), -1, 101, 1e9] * 3]
    choices = play(Chooser(switch()), [*both(0), *bad])
    assert choices[-1][1].model == "radar_only"
    assert "stale" in choices[-1][1].reason


def test_a_clock_that_goes_back_changes_nothing() -> None:
    chooser = Chooser(switch())
    chooser.update(noise_level("camera", 0), 10 * SECOND)
    chooser.update(noise_level("radar", 0), 10 * SECOND)
    assert chooser.update(noise_level("camera", 5), 0) is None
    assert chooser.update(noise_level("radar", 5), 10 * SECOND + TENTH) is None
    assert chooser.model == "both"


def test_a_rule_may_ask_for_a_low_level() -> None:
    rules = [
        {"sensor": "radar", "stale_s": 0.5, "model": "both"},
        {"sensor": "radar", "below": 20, "hysteresis": 10, "model": "radar_only"},
    ]
    levels = [50, 21, 20, 29, 30, 31, 25]
    chooser, models = Chooser(switch(0, rules)), []
    for number, level in enumerate(levels):
        chooser.update(noise_level("radar", level), number * TENTH)
        models.append(chooser.model)
    assert models == ["both", "both", *["radar_only"] * 3, "both", "both"]


def test_a_rule_may_be_of_some_kinds_only() -> None:
    rules = [
        {"sensor": "camera", "stale_s": 60, "model": "radar_only"},
        {"sensor": "camera", "above": 40, "hysteresis": 10, "kinds": ["under"], "model": "dark"},
    ]
    chooser, models = Chooser(switch(0, rules)), []
    for kind in ("noise", "under", "blur"):
        chooser.update(replace(noise_level("camera", 90), kind=kind), 0)
        models.append(chooser.model)
    assert models == ["both", "dark", "both"]


def test_a_choice_is_stamped_in_the_time_of_the_levels() -> None:
    chooser = Chooser(switch())
    first = chooser.update(noise_level("camera", 0, stamp_ns=7 * SECOND), 100 * SECOND)
    later = chooser.update(None, 101 * SECOND)
    assert first is not None
    assert first.stamp_ns == 7 * SECOND
    assert later is not None
    assert later.stamp_ns == 8 * SECOND


def test_the_reason_names_level_and_rule() -> None:
    choices = play(Chooser(switch(0)), [*both(0), *both(63), *both(29)])
    assert [choice.reason for _, choice in choices] == [
        "no rule holds: camera at 0 % (noise)",
        "camera at 63 % (noise): rule at least 40 %, hysteresis 10",
        "no rule holds: camera at 29 % (noise), radar at 0 % (noise)",
    ]
