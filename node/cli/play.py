"""``murk play``: CAN logs onto a bus, with their original timing."""

from __future__ import annotations

import signal
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from node.cli.output import emit

if TYPE_CHECKING:
    from rich.live import Live

    from node.player import Player


def play(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Merged by time.")],
    bus: Annotated[
        str, typer.Argument(metavar="BUS", help="can0, or INTERFACE:CHANNEL of python-can.")
    ],
    speed: Annotated[float, typer.Option(help="Factor on time; inf: as fast as it goes.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Begin again until Ctrl-C.")] = False,
    start: Annotated[
        float, typer.Option(help="Where to begin, seconds since the first frame.", metavar="S")
    ] = 0.0,
    end: Annotated[
        float | None, typer.Option(help="Where to end, seconds since the first frame.", metavar="S")
    ] = None,
    can_id: Annotated[
        list[str] | None,
        typer.Option("--id", help="Play only this identifier (hex); repeatable.", metavar="ID"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="The summary as a JSON object.")] = False,
) -> None:
    """Play CAN logs onto a bus with their original timing; Ctrl-C ends with a summary."""
    from dbc.errors import MurkError
    from drivers.can_bus import open_bus
    from node.player import Player, Recording

    ids = None if can_id is None else [_identifier(text) for text in can_id]
    recording = Recording(logs, ids=ids, start_s=start, end_s=end)
    next(recording.lap())  # a log that is no log is refused before the bus is touched
    error: MurkError | None = None
    with open_bus(bus) as opened:
        player = Player(recording, opened, speed=speed, loop=loop)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: player.stop())
        try:
            with nullcontext() if json else _progress(player):
                player.run()
        except MurkError as failed:
            error = failed
    if json:
        emit({"type": "summary", **player.summary()})
    else:
        _print(player.summary())
    if error is not None:
        raise error


def _identifier(text: str) -> int:
    from dbc.errors import SceneError

    try:
        can_id = int(text, 16)
    except ValueError:
        can_id = -1
    if not 0 <= can_id <= 0x1FFFFFFF:
        raise SceneError("--id", f"{text!r} is no CAN identifier", "give it in hex, such as 701")
    return can_id


def _progress(player: Player) -> Live:
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    def line() -> Text:
        return Text(f"{player.played_s:9.1f} s   {player.frames:,} frames   lap {player.laps}")

    console = Console(stderr=True)
    return Live(get_renderable=line, console=console, refresh_per_second=10, transient=True)


def _print(summary: dict[str, int | float]) -> None:
    from rich.console import Console

    laps = f" in {summary['laps']} laps" if summary["laps"] > 1 else ""
    lines = [
        f"{summary['frames']:,} frames{laps}, {summary['duration_s']:.1f} s",
        f"late: p99 {summary['late_p99_us']:,} µs, at most {summary['late_max_us']:,} µs",
    ]
    if summary["retries"]:
        lines.append(f"the send buffer was full {summary['retries']:,} times")
    if summary["skipped"]:
        lines.append(f"{summary['skipped']:,} error frames left out: they cannot be sent")
    Console().print("\n".join(lines), highlight=False)
