from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from dbc.errors import SceneError
from node.bus.in_process import Bus
from node.events import MODEL_TOPIC, ModelChoice
from node.plan import Plan, plan
from node.scene import check_scene
from node.switch import ModelSwitch, SwitchOutput
from tests.node.switching import RULES, SECOND, noise_level, switch

TOPIC = "/murk/{}/noise_level"
PATIENCE_S = 20.0


def wait_until(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def models(built: list[str]) -> dict[str, Callable[[], str]]:
    def build(name: str) -> Callable[[], str]:
        return lambda: (built.append(name), name)[1]

    return {name: build(name) for name in ("both", "radar_only", "camera_only")}


def test_models_are_built_before_the_first_level_and_never_again() -> None:
    built: list[str] = []
    made = ModelSwitch(switch(dwell_s=0), models(built))
    assert built == ["both", "radar_only", "camera_only"]
    assert set(made.warm_up_s) == set(built)
    assert made.model == made.chosen == "both"
    for number, level in enumerate([0, 90, 0, 90]):
        made.update(noise_level("camera", level), number)
        assert made.model == made.chosen == ("radar_only" if level else "both")
    assert len(built) == 3


def test_a_model_that_nobody_registered_is_told_before_any_level() -> None:
    some = models([])
    del some["camera_only"]
    with pytest.raises(SceneError, match="chooses 'camera_only', which is not registered"):
        ModelSwitch(switch(), some)


def test_every_choice_is_handed_on() -> None:
    choices: list[ModelChoice] = []
    made = ModelSwitch(switch(), models([]), choices.append)
    returned = [made.update(noise_level("camera", level), 0) for level in (0, 90)]
    assert choices == returned
    assert [choice.model for choice in choices] == ["both", "radar_only"]


def test_it_follows_levels_until_they_end() -> None:
    def levels() -> Iterator[Any]:
        yield None
        yield noise_level("camera", 90)

    made = ModelSwitch(switch(dwell_s=0), models([]))
    made.follow(levels())
    assert made.model == "radar_only"


def outputs_scene(fast: bool, dwell_s: float, rules: list[dict[str, Any]] = RULES) -> Plan:
    sensors = [{"name": name, "type": name, "source": "world"} for name in ("camera", "radar")]
    content = {"name": "detector", "default": "both", "dwell_s": dwell_s, "rules": rules}
    return plan(
        check_scene({"sensors": sensors, "switches": [content], "clock": {"fast": fast}}, "test")
    )


def test_the_output_publishes_changes_and_notices_silence() -> None:
    choices: list[ModelChoice] = []
    patient = {**RULES[1], "stale_s": 10 * PATIENCE_S}
    scene = outputs_scene(fast=False, dwell_s=0, rules=[RULES[0], patient, *RULES[2:]])
    with Bus() as bus:
        bus.subscribe(MODEL_TOPIC, choices.append)
        output = SwitchOutput(scene, bus)
        for count, level in enumerate((0.0, 90.0, 0.0), start=1):
            bus.publish(TOPIC.format("camera"), noise_level("camera", level))
            wait_until(lambda count=count: len(choices) >= count)
        wait_until(lambda: len(choices) == 4)
        output.close()
        assert output.counts() == {
            "levels": 3,
            "dropped": 0,
            "switches": {"detector": {"choices": 4, "model": "radar_only"}},
        }
    assert [choice.model for choice in choices] == ["both", "radar_only", "both", "radar_only"]
    assert "camera is stale" in choices[3].reason


def test_as_fast_as_possible_it_goes_by_the_recordings_time() -> None:
    def run(radar_first: bool) -> list[ModelChoice]:
        choices: list[ModelChoice] = []
        with Bus() as bus:
            listener = bus.subscribe(MODEL_TOPIC, choices.append)
            output = SwitchOutput(outputs_scene(fast=True, dwell_s=1.0), bus)
            camera = [
                noise_level("camera", 90.0 * (20 <= number < 24), number * SECOND // 10)
                for number in range(50)
            ]
            radar = [noise_level("radar", 0.0, 10**15 + n * SECOND // 10) for n in range(50)]
            for level in [*radar, *camera] if radar_first else [*camera, *radar]:
                bus.publish(TOPIC.format(level.sensor), level)
            output.close()
            assert output.counts()["levels"] == 100
            listener.close()
            listener.join(PATIENCE_S)
        return choices

    once = run(radar_first=True)
    assert [(choice.model, choice.stamp_ns) for choice in once] == [
        ("both", 0),
        ("radar_only", 2 * SECOND),
        ("both", 3 * SECOND),
    ]
    assert run(radar_first=False) == once
