"""``murk watch``: what a carrier carries, topic by topic."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from node.cli.output import emit, plain_console

if TYPE_CHECKING:
    from rich.table import Table

    from node.watch import Heard, TopicView

REFRESH_S = 0.2


def watch(
    source: Annotated[
        str,
        typer.Argument(metavar="CARRIER", help="ros2:, ros2:DOMAIN, can:BUS or FILE.mcap."),
    ] = "ros2:",
    duration: Annotated[
        float | None, typer.Option("--duration", metavar="S", help="Stop after S seconds.", min=0)
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object a message.")] = False,
) -> None:
    """Show the topics of a carrier, how often they come and their newest message."""
    from contextlib import closing
    from time import monotonic

    from rich.live import Live

    from node.watch import TopicView, open_carrier

    topics: dict[str, TopicView] = {}
    live = Live(console=plain_console(), auto_refresh=False)
    end_s = None if duration is None else monotonic() + duration
    with closing(open_carrier(source)) as carrier:
        if not json and live.console.is_terminal:
            live.start()
        try:
            while end_s is None or monotonic() < end_s:
                heard = carrier.heard(REFRESH_S)
                if heard is None:
                    break
                for message in heard:
                    topics.setdefault(message.topic, TopicView(message.type_name)).add(message)
                    if json:
                        _emit_message(message)
                if live.is_started:
                    live.update(_table(topics), refresh=True)
        except KeyboardInterrupt:
            pass
        finally:
            live.stop()
    if json:
        emit({"type": "summary", "topics": {name: _record(view) for name, view in topics.items()}})
    elif not live.console.is_terminal:
        live.console.print(_table(topics))


def _emit_message(heard: Heard) -> None:
    emit({"type": "message", **heard._asdict()})


def _record(view: TopicView) -> dict[str, object]:
    return {"type_name": view.type_name, "count": view.count, "rate_hz": view.rate_hz}


def _table(topics: dict[str, TopicView]) -> Table:
    from rich.table import Column, Table

    table = Table(Column("topic", no_wrap=True), "type", "messages", "Hz", "newest")
    for name, view in sorted(topics.items()):
        rate = "–" if view.rate_hz is None else f"{view.rate_hz:.1f}"
        table.add_row(name, view.type_name.rpartition("/")[2], str(view.count), rate, view.text)
    return table
