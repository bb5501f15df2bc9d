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
    level = injection.level_at(t_s)
    if t_s < pairs[0][0]:
        assert level == 0
    else:
        assert min(y for _, y in pairs) <= level <= max(y for _, y in pairs)
    assert injection.level_at(pairs[-1][0]) == pairs[-1][1]


def test_steps_hold_and_ramps_go_straight() -> None:
    step = Injection(sensor="cam", kind="blur", points=((1, 10), (3, 50)))
    ramp = Injection(sensor="cam", kind="blur", points=((1, 10), (3, 50)), shape="ramp")
    assert [step.level_at(t) for t in (0, 1, 2, 3, 9)] == [0, 10, 10, 50, 50]
    assert [ramp.level_at(t) for t in (0, 1, 2, 3, 9)] == [0, 10, 30, 50, 50]
