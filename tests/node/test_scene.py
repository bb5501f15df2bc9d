from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dbc.errors import SceneError
from node.scene import Injection, check_scene, parse_injection, read_scene_file

RADAR = {"name": "front", "type": "radar", "source": "world"}
CAMERA = {"name": "cam", "type": "camera", "source": "world"}


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ({"sensors": [RADAR], "sensorz": []}, "sensorz"),
        ({"sensors": [{**RADAR, "gain": 3}]}, "sensors.0.gain"),
        ({"sensors": [{**RADAR, "type": "lidar"}]}, "sensors.0.type"),
        ({"sensors": [{**RADAR, "sensor_id": 8}]}, "sensors.0.sensor_id"),
        ({"sensors": []}, "sensors"),
        ({"sensors": [RADAR, RADAR]}, "same name"),
        ({"sensors": [RADAR], "clock": {"speed": 0}}, "clock.speed"),
        ({"sensors": [RADAR], "duration_s": -1}, "duration_s"),
        ({"sensors": [RADAR], "seed": -1}, "seed"),
        (
            {"sensors": [RADAR], "injections": [{"sensor": "cam", "kind": "blur", "level": 1}]},
            "cam",
        ),
        (
            {"sensors": [RADAR], "injections": [{"sensor": "front", "kind": "blur", "level": 1}]},
            "blur",
        ),
        (
            {"sensors": [CAMERA], "injections": [{"sensor": "cam", "kind": "blur", "level": 101}]},
            "injections.0.level",
        ),
        (
            {
                "sensors": [CAMERA],
                "injections": [{"sensor": "cam", "kind": "blur", "level": float("nan")}],
            },
            "injections.0.level",
        ),
        (
            {"sensors": [CAMERA], "injections": [{"sensor": "cam", "kind": "blur", "level": True}]},
            "injections.0.level",
        ),
        ({"sensors": [CAMERA], "injections": [{"sensor": "cam", "kind": "blur"}]}, "injections.0"),
        (
            {
                "sensors": [CAMERA],
                "injections": [{"sensor": "cam", "kind": "blur", "points": [(2, 1), (1, 1)]}],
            },
            "decrease",
        ),
    ],
)
def test_a_wrong_scene_names_the_field_in_one_line(
    content: dict[str, object], expected: str
) -> None:
    with pytest.raises(SceneError) as caught:
        check_scene(content, "scene.toml")
    text = str(caught.value)
    assert text.startswith("scene.toml")
    assert expected in text
    assert "\n" not in text
    assert caught.value.exit_code == 2


def test_a_broken_file_names_the_line(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text("name = 'a'\nseed = = 3\n")
    with pytest.raises(SceneError, match="line 2"):
        read_scene_file(path)
    with pytest.raises(SceneError, match="No such file"):
        read_scene_file(tmp_path / "absent.toml")


def test_paths_are_relative_to_the_scene_file(tmp_path: Path) -> None:
    (tmp_path / "drive.log").touch()
    path = tmp_path / "scene.toml"
    path.write_text("[[sensors]]\nname='front'\ntype='radar'\nsource='drive.log'\n")
    scene = check_scene(read_scene_file(path), path)
    assert scene.sensors[0].source == str(tmp_path / "drive.log")


@pytest.mark.parametrize("flag", ["camera:noise", "camera", "camera:noise:sixty", "a:b:1:2", ""])
def test_a_wrong_injection_flag_says_what_is_expected(flag: str) -> None:
    with pytest.raises(SceneError, match="SENSOR:KIND:LEVEL"):
        parse_injection(flag)


points = st.lists(st.tuples(st.floats(0, 100), st.floats(0, 100)), min_size=1, max_size=6).map(
    lambda pairs: sorted(pairs, key=lambda pair: pair[0])
)


@given(points, st.sampled_from(["step", "ramp"]), st.floats(0, 200))
def test_a_schedule_stays_between_its_levels(
    pairs: list[tuple[float, float]], shape: str, t_s: float
) -> None:
    injection = Injection(sensor="cam", kind="blur", points=tuple(pairs), shape=shape)  # type: ignore[arg-type]
    schedule = injection.schedule(1)
    level = schedule.level_at(t_s)
    if t_s < pairs[0][0]:
        assert level == 0
    else:
        assert min(y for _, y in pairs) <= level <= max(y for _, y in pairs)
    assert schedule.level_at(pairs[-1][0]) == pairs[-1][1]


def test_steps_hold_and_ramps_go_straight() -> None:
    step = Injection(sensor="cam", kind="blur", points=((1, 10), (3, 50)))
    ramp = Injection(sensor="cam", kind="blur", points=((1, 10), (3, 50)), shape="ramp")
    assert [step.schedule(1).level_at(t) for t in (0, 1, 2, 3, 9)] == [0, 10, 10, 50, 50]
    assert [ramp.schedule(1).level_at(t) for t in (0, 1, 2, 3, 9)] == [0, 10, 30, 50, 50]


WALK = {"sensor": "cam", "kind": "blur", "shape": "walk", "level": 40, "spread": 20}
BURST = {"sensor": "cam", "kind": "blur", "shape": "burst", "level": 80,
         "duration_s": 0.5, "period_s": 2}  # fmt: skip


def injection_of(content: dict[str, object]) -> Injection:
    return check_scene({"sensors": [CAMERA], "injections": [content]}, "here").injections[0]


def test_a_walk_starts_at_its_level_stays_within_its_bounds_and_repeats() -> None:
    walk = injection_of(WALK | {"bounds": [30, 60]})
    schedule = walk.schedule(7)
    levels = [schedule.level_at(0.1 * step) for step in range(600)]
    assert levels[0] == pytest.approx(40)
    assert 30 <= min(levels) < 35
    assert 55 < max(levels) <= 60
    assert levels == [walk.schedule(7).level_at(0.1 * step) for step in range(600)]
    for other in (walk.schedule(8), injection_of(WALK | {"kind": "fog"}).schedule(7)):
        assert other.level_at(20.0) != schedule.level_at(20.0)


def test_a_burst_comes_back() -> None:
    schedule = injection_of(BURST | {"rest": 10}).schedule(1)
    assert [schedule.level_at(t) for t in (0, 0.4, 0.6, 1.9, 2.1)] == [80, 80, 10, 10, 80]
    assert injection_of(BURST).schedule(1).level_at(1.0) == 0


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ({**WALK, "spread": None}, "shape 'walk' needs 'spread'"),
        ({**WALK, "spread": -1}, "injections.0.spread"),
        ({**WALK, "bounds": [60, 30]}, "'bounds'"),
        ({**WALK, "bounds": [50, 60]}, "'level' must lie within 'bounds'"),
        ({**WALK, "bounds": [0, 101]}, "injections.0.bounds.1"),
        ({**WALK, "period_s": 1}, "'period_s' is not of shape 'walk'"),
        ({**WALK, "points": [[0, 1]]}, "'points' is not of shape 'walk'"),
        ({**BURST, "level": None}, "shape 'burst' needs 'level'"),
        ({**BURST, "period_s": 0}, "injections.0.period_s"),
        ({**BURST, "duration_s": 3}, "'duration_s' must not be longer"),
        ({**BURST, "shape": "step"}, "'duration_s' is not of shape 'step'"),
        ({**BURST, "shape": "jump"}, "injections.0.shape"),
        ({**BURST, "horizon": 0.5}, "'horizon' is not of kind 'blur'"),
        ({**BURST, "kind": "fog", "horizon": 1.5}, "injections.0.horizon"),
        ({**BURST, "kind": "fog", "ghost_life": 5}, "'ghost_life' is not of kind 'fog'"),
        ({**BURST, "snr_drop_db": 20}, "'snr_drop_db' is not of kind 'blur'"),
        ({**BURST, "kind": "over", "method": "published"}, "'over' has no published method"),
        ({**BURST, "kind": "noise", "std_max": 300}, "injections.0.std_max"),
    ],
)
def test_an_impossible_schedule_names_its_field(content: dict[str, object], expected: str) -> None:
    given = {name: value for name, value in content.items() if value is not None}
    with pytest.raises(SceneError) as caught:
        injection_of(given)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)
