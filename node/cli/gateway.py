"""``murk gateway``: between a sensor and the unit under test, and its control while it runs."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated, Any

import typer

from node.cli.output import emit, plain_console
from node.cli.scene_flags import InjectFlag, SeedFlag

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from node.gateway import Gateway

WAIT_S = 0.1

Arguments = Annotated[
    list[str],
    typer.Argument(metavar="IN OUT [SCENE] | set SENSOR KIND LEVEL", show_default=False),
]


def gateway(
    arguments: Arguments,
    inject: InjectFlag = None,
    fault: Annotated[
        list[str] | None,
        typer.Option("--fault", metavar="FAULT:RATE", help="Fault at a rate in %; repeatable."),
    ] = None,
    sensor: Annotated[
        str | None,
        typer.Option("--sensor", metavar="NAME", help="Which of SCENE's sensors; or a name."),
    ] = None,
    sensor_id: Annotated[
        int | None,
        typer.Option("--sensor-id", metavar="N", min=0, max=7, help="The radar's SensorID."),
    ] = None,
    both_ways: Annotated[
        bool,
        typer.Option("--both-ways", help="Also pass what OUT sends (CAN) to IN, untouched."),
    ] = False,
    low_latency: Annotated[
        bool,
        typer.Option("--low-latency", help="Send each cluster (CAN) when it comes."),
    ] = False,
    seed: SeedFlag = None,
    duration: Annotated[
        float | None, typer.Option("--duration", metavar="S", help="Stop after S seconds.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object a line.")] = False,
) -> None:
    """Stand between a sensor and the unit under test, and make the sensor worse.

    IN and OUT are CAN buses (can0 can1, virtual:a virtual:b): every frame
    passes untouched, but the cluster scans of the radar are degraded. Each of
    them may also be a CAN log; from log to log it goes as fast as possible.

    Or IN is a camera (/dev/video0, a video, images, 'world') and OUT a video
    (x.mp4, x.mkv), raw BGR frames ('-', pipe:PATH) or a V4L2 output.

    SCENE is a scene file; IN takes the place of its sources. Faults of CAN are
    drop, delay, duplicate, reorder, corrupt, freeze, stuck, silence, babble;
    those of a camera are frozen, black, torn, late, dropped.

    'murk gateway set SENSOR KIND LEVEL' changes a running gateway: the level
    of a kind or the rate of a fault, in %. SENSOR is radar or camera, or what
    SCENE or --sensor calls it.
    """
    if arguments[0] == "set":
        _set(arguments[1:])
        return
    running = _open(
        arguments,
        both_ways=both_ways,
        low_latency=low_latency,
        json=json,
        name=sensor,
        sensor_id=sensor_id,
        inject=inject or (),
        fault=fault or (),
        seed=seed,
        duration_s=duration,
    )
    _execute(running, to_stdout=arguments[1] == "-", json=json)


def _set(arguments: list[str]) -> None:
    from dbc.errors import InputError
    from node.control import set_level

    expected = "expected murk gateway set SENSOR KIND LEVEL, for example: set radar snr 60"
    try:
        sensor, kind, text = arguments
        level = float(text)
    except ValueError:
        raise InputError(" ".join(["set", *arguments]), "is no command", expected) from None
    set_level(sensor, kind, level)


def _open(
    arguments: list[str], *, both_ways: bool, low_latency: bool, json: bool, **flags: Any
) -> Gateway:
    from dbc.errors import InputError
    from node.gateway import Gateway, sensor_type_of
    from node.gateway_scene import build_gateway_scene

    if not 2 <= len(arguments) <= 3:
        raise InputError(" ".join(arguments), "is not IN OUT [SCENE]", "see murk gateway --help")
    source, target, *rest = arguments
    if json and target == "-":
        raise InputError("--json", "standard output carries the frames", "give pipe:PATH as OUT")
    scene_file = Path(rest[0]) if rest else None
    scene = build_gateway_scene(scene_file, sensor_type_of(target), source, **flags)
    return Gateway(scene, target, both_ways=both_ways, low_latency=low_latency)


def _execute(gateway: Gateway, *, to_stdout: bool, json: bool) -> None:
    """Run a gateway until its input ends or a signal comes, then say what it has done."""
    from dbc.errors import MurkError

    stop = Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    start = gateway.summary()
    if json:
        emit({"type": "started", **{key: start[key] for key in ("sensor", "input", "output")}})
        sys.stdout.flush()
    else:
        _console(to_stdout).print(
            f"{start['sensor']}: {start['input']} → {start['output']}; Ctrl-C ends", highlight=False
        )
    error: MurkError | None = None
    gateway.start()
    while not stop.is_set() and not gateway.wait(WAIT_S):
        pass
    try:
        gateway.stop()
    except MurkError as failed:
        error = failed
    summary = gateway.summary()
    if json:
        emit({"type": "summary", **summary})
    else:
        _console(to_stdout).print(_table(summary))
    if error is not None:
        raise error


def _console(to_stdout: bool) -> Console:
    """Return where a person reads: standard output, unless that carries frames."""
    return plain_console(stderr=to_stdout)


def _table(summary: dict[str, Any]) -> Table:
    from rich.table import Table

    table = Table(show_header=False, box=None)
    faults = {f"fault {name}": count for name, count in summary["faults"].items() if count}
    for name, value in (summary | faults).items():
        if name != "faults":
            shown = f"{value / 1e6:.2f} ms" if name.endswith("_ns") else str(value)
            table.add_row(name.removesuffix("_ns").replace("_", " "), shown)
    return table
