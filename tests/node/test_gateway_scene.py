from __future__ import annotations

from pathlib import Path

import pytest

from dbc.errors import SceneError
from node.gateway_levels import GatewayLevels
from node.gateway_scene import build_gateway_scene

SCENE = """
seed = 7
duration_s = 3.0
sensors = [
    {name = "front", type = "radar", source = "drive.log", sensor_id = 2},
    {name = "rear", type = "radar", source = "world"},
    {name = "camera", type = "camera", source = "world"},
]
injections = [
    {sensor = "front", kind = "snr", points = [[1, 60]]},
    {sensor = "camera", kind = "blur", level = 10},
]
faults = [
    {sensor = "front", kind = "drop", points = [[0, 0], [10, 100]], shape = "ramp"},
    {sensor = "camera", kind = "black", level = 5},
]
"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def test_flags_make_a_scene_of_one_sensor() -> None:
    scene = build_gateway_scene(
        None, "radar", "can0", sensor_id=3, inject=["radar:snr:60"], fault=["drop:5"], seed=9
    )
    assert (scene.sensor.name, scene.sensor.source, scene.sensor.sensor_id) == ("radar", "can0", 3)
    assert [(one.kind, one.level) for one in scene.injections] == [("snr", 60)]
    assert [(one.kind, one.level) for one in scene.faults] == [("drop", 5)]
    assert (scene.seed, scene.duration_s) == (9, None)


def test_a_scene_file_gives_what_concerns_the_chosen_sensor(scene_file: Path) -> None:
    scene = build_gateway_scene(scene_file, "radar", "can0", name="front", seed=8)
    assert (scene.sensor.name, scene.sensor.source, scene.sensor.sensor_id) == ("front", "can0", 2)
    assert [one.kind for one in scene.injections] == ["snr"]
    assert [one.kind for one in scene.faults] == ["drop"]
    assert (scene.seed, scene.duration_s) == (8, 3.0)
    assert build_gateway_scene(scene_file, "camera", "x.mp4").sensor.name == "camera"


def test_schedules_and_calls_make_the_levels(scene_file: Path) -> None:
    scene = build_gateway_scene(scene_file, "radar", "can0", name="front")
    levels = GatewayLevels(scene.sensor, scene.injections, scene.faults, scene.seed)
    assert not levels.any_at(0)
    assert levels.rates_at(5) == {"drop": 50}
    assert levels.injector.levels_at(5) == {"snr": 60}
    levels.set_level("drop", 0)
    levels.set_level("snr", 0)
    assert not levels.any_at(5)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ({}, "has several radars; choose with --sensor: front, rear"),
        ({"name": "camera"}, "--sensor camera: is no radar of the scene; it has front, rear"),
        ({"name": "front", "fault": ["drop"]}, "--fault drop: is not a fault"),
        ({"name": "front", "fault": ["drop:x"]}, "--fault drop:x: is not a fault"),
        ({"name": "front", "fault": ["black:5"]}, "a radar has no fault 'black'"),
        ({"name": "front", "fault": ["drop:5"]}, "drop is given twice"),
        ({"name": "front", "fault": ["stuck:101"]}, "less than or equal to 100"),
        ({"name": "front", "inject": ["front:blur:5"]}, "a radar has no kind 'blur'"),
        ({"name": "front", "seed": -1}, "seed"),
    ],
)
def test_a_wrong_flag_is_named(flags: dict[str, object], message: str, scene_file: Path) -> None:
    with pytest.raises(SceneError) as told:
        build_gateway_scene(scene_file, "radar", "can0", **flags)  # type: ignore[arg-type]
    assert message in str(told.value)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ('{sensor = "back", kind = "drop", level = 1}', "faults.0: fault of 'back'"),
        ('{sensor = "front", kind = "drop"}', "faults.0: give either 'level' or 'points'"),
        ('{sensor = "front", kind = "drop", rate = 1}', "faults.0.rate"),
        ('{sensor = "camera", kind = "drop", level = 1}', "a camera has no fault 'drop'"),
    ],
)
def test_a_wrong_fault_of_a_scene_is_named(fault: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.split("faults", maxsplit=1)[0] + f"faults = [{fault}]")
    with pytest.raises(SceneError) as told:
        build_gateway_scene(path, "radar", "can0", name="front")
    assert message in str(told.value)


def test_a_scene_without_the_sensor_is_told(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text('sensors = [{name = "camera", type = "camera", source = "world"}]')
    with pytest.raises(SceneError, match="has no radar"):
        build_gateway_scene(path, "radar", "can0")
