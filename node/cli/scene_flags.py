"""The flags that describe a scene, shared by the commands that run or plan one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from node.recording import is_recording, read_recording
from node.scene import Scene, check_scene, parse_injection, read_scene_file

SceneFile = Annotated[
    Path | None,
    typer.Argument(
        metavar="[SCENE]",
        help="Scene file (TOML), or a recording (MCAP) to replay.",
        show_default=False,
    ),
]
RadarFlag = Annotated[
    str | None,
    typer.Option("--radar", metavar="SRC", help="CAN log, MCAP, CAN bus or 'world'."),
]
CameraFlag = Annotated[
    str | None,
    typer.Option("--camera", metavar="SRC", help="Video, folder, MCAP, /dev/videoN or 'world'."),
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
RecordFlag = Annotated[
    Path | None, typer.Option("--record", metavar="FILE", help="Record to an MCAP file.")
]
Ros2Flag = Annotated[bool, typer.Option("--ros2", help="Publish to ROS 2 over DDS.")]
CanFlag = Annotated[
    str | None, typer.Option("--can", metavar="BUS", help="Publish the levels on a CAN bus.")
]
ViewFlag = Annotated[bool, typer.Option("--view", help="Serve a live page on 127.0.0.1.")]
HostFlag = Annotated[
    str | None, typer.Option("--host", metavar="ADDRESS", help="Serve the page there instead.")
]
PortFlag = Annotated[int | None, typer.Option("--port", help="Port of the page.")]
TokenFlag = Annotated[
    str | None, typer.Option("--token", help="Secret that the page asks for; see --host.")
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
    outputs: dict[str, Any] | None = None,
) -> Scene:
    """Build the scene of a scene file and flags; a flag goes before what the file says.

    Raises
    ------
    SceneError
        If the file cannot be read, or file or flags are wrong.
    """
    content: dict[str, Any] = _read(scene_file) if scene_file else {}
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
    _merge(content, "outputs", outputs or {})
    if "sensors" not in content:
        from dbc.errors import SceneError

        raise SceneError(where, "has no sensor", "give a scene file, --radar SRC or --camera SRC")
    return check_scene(content, where)


def _read(path: Path) -> dict[str, Any]:
    return read_recording(path) if is_recording(str(path)) else read_scene_file(path)


def output_flags(
    *,
    picture: Path | None,
    record: Path | None,
    ros2: bool,
    can: str | None,
    view: bool,
    host: str | None,
    port: int | None,
    token: str | None,
) -> dict[str, Any]:
    """Return the content of a scene's ``outputs`` that flags ask for.

    Raises
    ------
    SceneError
        If a flag of the page is given without the page.
    """
    given = {"host": host, "port": port, "token": token}
    page = {name: value for name, value in given.items() if value is not None}
    if page and not view:
        from dbc.errors import SceneError

        raise SceneError("--" + next(iter(page)), "is of the page", "give --view too")
    return {
        "picture": picture,
        "record": {"path": record} if record else None,
        "ros2": {} if ros2 else None,
        "can": {"bus": can} if can else None,
        "view": page if view else None,
    }


def _merge(content: dict[str, Any], table: str, flags: dict[str, Any]) -> None:
    given = {key: value for key, value in flags.items() if value is not None}
    if given:
        content[table] = {**content.get(table, {}), **given}
