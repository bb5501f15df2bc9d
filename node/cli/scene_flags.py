"""The flags that describe a scene, shared by the commands that run or plan one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from node.scene import Scene, check_scene, parse_injection, read_scene_file

SceneFile = Annotated[
    Path | None, typer.Argument(metavar="[SCENE]", help="Scene file (TOML).", show_default=False)
]
RadarFlag = Annotated[
    str | None,
    typer.Option("--radar", metavar="SRC", help="CAN log, CAN bus (socketcan:can0) or 'world'."),
]
CameraFlag = Annotated[
    str | None,
    typer.Option("--camera", metavar="SRC", help="Video, folder, /dev/videoN or 'world'."),
]
InjectFlag = Annotated[
    list[str] | None,
    typer.Option("--inject", metavar="SENSOR:KIND:LEVEL", help="Degrade live; repeatable."),
]
SpeedFlag = Annotated[
    float | None, typer.Option("--speed", metavar="X", help="Times real time, for recordings.")
]
FastFlag = Annotated[
    bool, typer.Option("--fast", help="As fast as possible, nothing dropped, for recordings.")
]
LoopFlag = Annotated[bool, typer.Option("--loop", help="Start recordings again at their end.")]
DurationFlag = Annotated[
    float | None, typer.Option("--duration", metavar="S", help="Stop after S seconds of data.")
]
SeedFlag = Annotated[
    int | None, typer.Option("--seed", metavar="N", help="Seed of the injections and the world.")
]


def build_scene(
    scene_file: Path | None,
    *,
    radar: str | None = None,
    camera: str | None = None,
    inject: list[str] | None = None,
    speed: float | None = None,
    fast: bool = False,
    loop: bool = False,
    duration: float | None = None,
    seed: int | None = None,
    picture: Path | None = None,
) -> Scene:
    """Build the scene of a scene file and flags; a flag goes before what the file says.

    Raises
    ------
    SceneError
        If the file cannot be read, or file or flags are wrong.
    """
    content: dict[str, Any] = read_scene_file(scene_file) if scene_file else {}
    where = scene_file or "flags"
    flags: dict[str, Any] = {"seed": seed, "duration_s": duration}
    content |= {key: value for key, value in flags.items() if value is not None}
    for name, source in (("radar", radar), ("camera", camera)):
        if source is not None:
            others = [one for one in content.get("sensors", []) if one.get("name") != name]
            content["sensors"] = [*others, {"name": name, "type": name, "source": source}]
    content["injections"] = [*content.get("injections", []), *map(parse_injection, inject or [])]
    clock: dict[str, Any] = {"speed": speed, "fast": fast or None, "loop": loop or None}
    _merge(content, "clock", clock)
    _merge(content, "outputs", {"picture": picture})
    if "sensors" not in content:
        from dbc.errors import SceneError

        raise SceneError(where, "has no sensor", "give a scene file, --radar SRC or --camera SRC")
    return check_scene(content, where)


def _merge(content: dict[str, Any], table: str, flags: dict[str, Any]) -> None:
    given = {key: value for key, value in flags.items() if value is not None}
    if given:
        content[table] = {**content.get(table, {}), **given}
