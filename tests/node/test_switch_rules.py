from __future__ import annotations

from typing import Any

import pytest

from dbc.errors import SceneError
from node.plan import plan
from node.scene import Scene, check_scene
from tests.node.switching import RULES

SENSORS = [
    {"name": "camera", "type": "camera", "source": "world"},
    {"name": "radar", "type": "radar", "source": "world"},
]
SWITCH: dict[str, Any] = {"name": "detector", "default": "both", "rules": RULES}


def scene(**changes: Any) -> Scene:
    return check_scene({"sensors": SENSORS, "switches": [SWITCH | changes]}, "test.toml")


def with_rule(**rule: Any) -> dict[str, Any]:
    return {"rules": [{"model": "radar_only", "sensor": "camera", **rule}, *RULES[:2]]}


def test_models_and_sensors_in_order() -> None:
    (switch,) = scene().switches
    assert switch.models == ("both", "radar_only", "camera_only")
    assert switch.sensors == ("camera", "radar")


def test_the_plan_keeps_a_switch_only_where_the_scene_has_one() -> None:
    assert plan(scene()).keeps("switch")
    without = plan(check_scene({"sensors": SENSORS}, "test.toml"))
    assert not without.keeps("switch")


@pytest.mark.parametrize(
    ("changes", "field", "what"),
    [
        ({"dwell_s": -1}, "switches.0.dwell_s", "greater than or equal to 0"),
        ({"dwell_s": float("inf")}, "switches.0.dwell_s", "finite|less than"),
        ({"default": ""}, "switches.0.default", "match"),
        ({"rules": []}, "switches.0.rules", "at least 1"),
        ({"rule": 1}, "switches.0.rule", "is not a key"),
        (with_rule(above=140, hysteresis=5), "switches.0.rules.0.above", "less than or equal"),
        (with_rule(above=40), "switches.0.rules.0", "give 'hysteresis'"),
        (with_rule(above=5, hysteresis=5), "switches.0.rules.0", "never end"),
        (with_rule(below=95, hysteresis=5), "switches.0.rules.0", "never end"),
        (with_rule(above=40, below=60, hysteresis=5), "switches.0.rules.0", "give one of"),
        (with_rule(), "switches.0.rules.0", "give one of"),
        (with_rule(stale_s=0), "switches.0.rules.0.stale_s", "greater than 0"),
        (with_rule(stale_s=1, hysteresis=5), "switches.0.rules.0", "'hysteresis'"),
        (with_rule(stale_s=1, kinds=["blur"]), "switches.0.rules.0", "'kinds'"),
        (with_rule(above=40, hysteresis=5, kinds=[]), "switches.0.rules.0.kinds", "at least 1"),
        (with_rule(above=40, hysteresis=5, kinds=["snr"]), "switches.0.rules.0", "of kind 'snr'"),
        (with_rule(stale_s=1), "switches.0", "two rules say which model when 'camera'"),
        ({"rules": RULES[2:]}, "switches.0", "no rule says which model when 'camera'"),
        (with_rule(sensor="rear", stale_s=1), "switches.0.rules.0", "of 'rear', but the sensors"),
        (with_rule(above=40, hysteresis=float("nan")), "switches.0.rules.0.hysteresis", "finite"),
    ],
)
def test_an_impossible_value_is_refused_by_its_field(
    changes: dict[str, Any], field: str, what: str
) -> None:
    with pytest.raises(SceneError, match=what) as caught:
        scene(**changes)
    assert str(caught.value).startswith(f"test.toml: {field}")
    assert "\n" not in str(caught.value)


def test_two_switches_of_one_name() -> None:
    with pytest.raises(SceneError, match=r"switches\.1: 'detector' is given twice"):
        check_scene({"sensors": SENSORS, "switches": [SWITCH, SWITCH]}, "test.toml")
