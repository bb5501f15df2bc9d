"""``murk play``: CAN logs onto a bus, with their original timing."""

from __future__ import annotations

import signal
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from node.cli.output import emit, plain_console

if TYPE_CHECKING:
    from rich.live import Live

    from node.player import Player
    from node.video_player import VideoPlayer


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
    video: Annotated[
        Path | None, typer.Option(help="Video of the same drive, in step.", metavar="FILE")
    ] = None,
    video_to: Annotated[
        str | None,
        typer.Option(help="Where it goes: /dev/videoN, x.mp4, pipe:PATH or -.", metavar="OUT"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="The summary as a JSON object.")] = False,
) -> None:
    """Play CAN logs onto a bus with their original timing; Ctrl-C ends with a summary."""
    from dbc.errors import MurkError, SceneError
    from drivers.can_bus import open_bus
    from node.player import Player, Recording

    ids = None if can_id is None else [_identifier(text) for text in can_id]
    recording = Recording(logs, ids=ids, start_s=start, end_s=end)
    next(recording.lap())  # a log that is no log is refused before the bus is touched
    if (video is None) != (video_to is None):
        raise SceneError("--video", "needs --video-to, and the other way round", "give both")
    error: MurkError | None = None
    with ExitStack() as stack:
        opened = stack.enter_context(open_bus(bus))
        player = Player(recording, opened, speed=speed, loop=loop)
        beside: VideoPlayer | None = None
        if video is not None and video_to is not None:
            beside = _beside(player, video, video_to, start, speed)
            stack.callback(beside.close)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: player.stop())
        try:
            with nullcontext() if json else _progress(player):
                player.run()
        except MurkError as failed:
            error = failed
    summary = player.summary()
    if beside is not None:
        summary |= {"video_frames": beside.shown, "video_skipped": beside.skipped}
        error = error or beside.error
    if json:
        emit({"type": "summary", **summary})
    else:
        _print(summary)
    if error is not None:
        raise error


def _beside(
    player: Player, video: Path, video_to: str, start_s: float, speed: float
) -> VideoPlayer:
    """Play a video in step with the logs."""
    from node.video_player import VideoPlayer

    beside = VideoPlayer(video, video_to, start_s=start_s, speed=speed)
    player.at_lap = beside.begin
    return beside


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
    from rich.live import Live
    from rich.text import Text

    def line() -> Text:
        return Text(f"{player.played_s:9.1f} s   {player.frames:,} frames   lap {player.laps}")

    console = plain_console(stderr=True)
    return Live(get_renderable=line, console=console, refresh_per_second=10, transient=True)


def _print(summary: dict[str, int | float]) -> None:
    laps = f" in {summary['laps']} laps" if summary["laps"] > 1 else ""
    lines = [
        f"{summary['frames']:,} frames{laps}, {summary['duration_s']:.1f} s",
        f"late: p99 {summary['late_p99_us']:,} µs, at most {summary['late_max_us']:,} µs",
    ]
    if summary["retries"]:
        lines.append(f"the send buffer was full {summary['retries']:,} times")
    if "video_frames" in summary:
        shown, skipped = summary["video_frames"], summary["video_skipped"]
        lines.append(f"video: {shown:,} frames shown, {skipped:,} too late")
    if summary["skipped"]:
        lines.append(f"{summary['skipped']:,} error frames left out: they cannot be sent")
    plain_console().print("\n".join(lines), highlight=False)
