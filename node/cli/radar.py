"""``murk radar``: what a radar does, and telling it what to do."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from node.cli.output import emit, plain_console

app = typer.Typer(help="Ask a radar what it does, or tell it what to do.", no_args_is_help=True)

BusArgument = Annotated[
    str, typer.Argument(metavar="BUS", help="can0, or INTERFACE:CHANNEL of python-can.")
]
SensorFlag = Annotated[int, typer.Option("--sensor-id", min=0, max=7, help="The radar's SensorID.")]
JsonFlag = Annotated[bool, typer.Option("--json", help="One JSON object.")]


@app.command()
def status(
    bus: BusArgument,
    sensor_id: SensorFlag = 0,
    timeout: Annotated[float, typer.Option(min=0.1, metavar="S", help="Patience.")] = 3.0,
    json: JsonFlag = False,
) -> None:
    """Show what a radar says of itself."""
    from node.radar_config import RadarLink

    with RadarLink(bus, sensor_id) as radar:
        said = radar.status(timeout)
    if json:
        record = {"type": "radar_status", "sensor_id": sensor_id}
        emit({**record, "state": said.state, "version": said.version})
    else:
        _print(f"radar {sensor_id}", said.state, said.version)


@app.command()
def configure(
    bus: Annotated[
        str, typer.Argument(metavar="BUS|SCENE", help="A bus, or a scene file with settings.")
    ],
    sensor_id: SensorFlag = 0,
    output: Annotated[
        str | None, typer.Option(help="clusters, objects or none.", metavar="WHAT")
    ] = None,
    quality: Annotated[
        bool | None, typer.Option("--quality/--no-quality", help="Send the quality lists.")
    ] = None,
    extended: Annotated[
        bool | None, typer.Option("--extended/--no-extended", help="Send extended lists.")
    ] = None,
    max_distance: Annotated[
        float | None, typer.Option(help="Farthest distance, even metres.", metavar="M")
    ] = None,
    power: Annotated[
        str | None, typer.Option(help="standard, -3dB, -6dB or -9dB.", metavar="POWER")
    ] = None,
    sort_index: Annotated[
        int | None, typer.Option("--sort", help="SortIndex.", min=0, max=7, metavar="N")
    ] = None,
    rcs_threshold: Annotated[
        str | None, typer.Option(help="standard or high (sensitivity).", metavar="WHAT")
    ] = None,
    filters: Annotated[
        list[str] | None,
        typer.Option(
            "--filter",
            help="Let through only clusters (object:…: objects) between two values; repeatable.",
            metavar="NAME:MIN:MAX",
        ),
    ] = None,
    store: Annotated[
        bool, typer.Option("--store", help="Keep it over a restart; wears the radar's memory.")
    ] = False,
    timeout: Annotated[float, typer.Option(min=0.1, metavar="S", help="Patience.")] = 5.0,
    json: JsonFlag = False,
) -> None:
    """Set a radar up: sent until it says that it does what was asked."""
    from dbc.errors import SceneError
    from drivers.radar_settings import SETTINGS, RadarFilter

    if store:
        sys.stderr.write("murk: --store writes the radar's memory, which wears out by that\n")
    if bus.endswith(".toml"):
        _configure_scene(Path(bus), store=store, timeout_s=timeout, json=json)
        return
    from node.radar_config import RadarLink

    asked: dict[str, str | float | None] = {
        "output": output,
        "quality": quality,
        "extended": extended,
        "max-distance": max_distance,
        "power": power,
        "sort-index": sort_index,
        "rcs-threshold": rcs_threshold,
    }
    wanted = {
        flag: SETTINGS[flag].value(asked_for)
        for flag, asked_for in asked.items()
        if asked_for is not None
    }
    parsed = [RadarFilter.parse(text) for text in filters or []]
    if not wanted and not parsed:
        raise SceneError("murk radar configure", "nothing is to be set", "give --output clusters")
    with RadarLink(bus, sensor_id) as radar:
        radar.configure(wanted, parsed, store=store, timeout_s=timeout)
    if json:
        record = {"type": "radar_configured", "sensor_id": sensor_id, "settings": wanted}
        emit({**record, "filters": filters or [], "stored": store})
    else:
        words = [f"{flag} {SETTINGS[flag].say(value)}" for flag, value in wanted.items()]
        words += [f"filter {one.name} {one.low:g} to {one.high:g}" for one in parsed]
        sys.stdout.write(f"radar {sensor_id} confirms {', '.join(words)}\n")


def _configure_scene(path: Path, *, store: bool, timeout_s: float, json: bool) -> None:
    """Set up every radar on a bus for which a scene has settings."""
    from dbc.errors import SceneError
    from node.radar_config import apply_settings
    from node.scene import check_scene, read_scene_file

    scene = check_scene(read_scene_file(path), path)
    radars = [sensor for sensor in scene.sensors if sensor.settings is not None]
    if not radars:
        raise SceneError(path, "has no settings for a radar", "give [sensors.settings]")
    for radar in radars:
        apply_settings(radar, store=store, timeout_s=timeout_s)
        if json:
            emit({"type": "radar_configured", "sensor": radar.name, "stored": store})
        else:
            sys.stdout.write(f"{radar.name} confirms its settings\n")


def _print(title: str, state: dict[str, float], version: dict[str, float] | None) -> None:
    from rich.table import Table

    from drivers.radar_settings import say_state

    table = Table("signal", "value", title=title)
    if version is not None:
        release = ("MajorRelease", "MinorRelease", "PatchLevel")
        table.add_row("version", ".".join(f"{version[part]:g}" for part in release))
    for name, value in say_state(state).items():
        table.add_row(name, value)
    plain_console().print(table)
