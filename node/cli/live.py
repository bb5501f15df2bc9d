"""The levels live in the terminal, and the summary of a run as a table."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable
from time import monotonic
from types import TracebackType
from typing import Any, Self

from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from models.estimate.level import NoiseLevel
from node.cli.output import plain_console
from node.events import ModelChoice

BAR_WIDTH = 40
REFRESH_S = 0.1


class LiveView:
    """A table of the sensors' newest levels, refreshed some times a second.

    Where standard output is no terminal it prints a line a sensor and second instead.
    """

    def __init__(self) -> None:
        self._console = plain_console()
        self._live = Live(console=self._console, auto_refresh=False)
        self._newest: dict[str, NoiseLevel] = {}
        self._arrivals: dict[str, deque[float]] = {}
        self._choices: dict[str, ModelChoice] = {}
        self._shown_s = 0.0

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._console.is_terminal:
            self._live.update(self._table(), refresh=True)
            self._live.stop()

    def show(self, level: NoiseLevel) -> None:
        """Take in a level, and refresh the view where it is time to."""
        now = monotonic()
        self._newest[level.sensor] = level
        self._arrivals.setdefault(level.sensor, deque(maxlen=30)).append(now)
        period = REFRESH_S if self._console.is_terminal else 1.0
        if now - self._shown_s < period:
            return
        self._shown_s = now
        if self._console.is_terminal:
            self._live.update(self._table(), refresh=True)
        else:
            for newest in self._newest.values():
                sys.stdout.write(_line(newest) + "\n")

    def choose(self, choice: ModelChoice) -> None:
        """Take in what a switch chose; shown with the next refresh, or as a line at once."""
        self._choices[choice.switch] = choice
        if not self._console.is_terminal:
            sys.stdout.write(f"{choice.switch}: {choice.model}  ({choice.reason})\n")

    def _rate_hz(self, sensor: str) -> float:
        times = self._arrivals[sensor]
        span = times[-1] - times[0]
        return (len(times) - 1) / span if span > 0 else 0.0

    def _table(self) -> Group:
        table = Table("sensor", "noise level", "%", "± %", "kind", "injected", "Hz", "dropped")
        for sensor, level in sorted(self._newest.items()):
            table.add_row(
                sensor,
                _bar(level),
                f"{level.level:.0f}",
                f"{level.std:.0f}",
                level.kind,
                _injected(level),
                f"{self._rate_hz(sensor):.1f}",
                str(level.dropped),
            )
        active = [
            Text(f"{name}: {choice.model}  ({choice.reason})")
            for name, choice in list(self._choices.items())
        ]
        return Group(table, *active)


def _bar(level: NoiseLevel) -> Text:
    """Draw the level as a bar, its uncertainty lighter, the injected level as a mark."""
    cells = [" "] * BAR_WIDTH
    low, high = level.level - level.std, level.level + level.std
    for cell in range(BAR_WIDTH):
        percent = 100.0 * (cell + 0.5) / BAR_WIDTH
        cells[cell] = "█" if percent <= max(low, 0.0) else "▒" if percent <= high else "·"
    if level.injected:
        cells[min(BAR_WIDTH - 1, int(level.true_level / 100 * BAR_WIDTH))] = "┃"
    colour = "green" if level.level < 20 else "yellow" if level.level < 50 else "red"
    return Text("".join(cells), style=colour)


def _injected(level: NoiseLevel) -> str:
    if not level.injected:
        return "–"
    return ", ".join(f"{kind} {value:.0f}" for kind, value in level.injected.items())


def _line(level: NoiseLevel) -> str:
    return (
        f"{level.sensor}: {level.level:5.1f} % ± {level.std:4.1f}  {level.kind:7s}"
        f" injected {_injected(level)}  dropped {level.dropped}"
    )


def print_summary(summary: dict[str, Any]) -> None:
    """Print the summary of a run as a table for a person, a column a sensor."""
    console = plain_console()
    table = Table("", *summary["sensors"], title=f"{summary['scene']}, {summary['wall_time_s']} s")
    for name, text in _ROWS.items():
        table.add_row(name, *(text(counts) for counts in summary["sensors"].values()))
    console.print(table)
    for name, counts in summary.get("outputs", {}).items():
        words = ", ".join(f"{key} {value}" for key, value in counts.items())
        console.print(f"{name}: {words}", highlight=False)
    if "picture" in summary:
        console.print(f"picture: {summary['picture']}")


def _if_estimated(text: str) -> Callable[[dict[str, Any]], str]:
    def row(counts: dict[str, Any]) -> str:
        return text.format(**counts) if counts["estimated"] else "–"

    return row


_ROWS: dict[str, Callable[[dict[str, Any]], str]] = {
    "state": "{state}".format_map,
    "received": "{received}".format_map,
    "estimated": "{estimated}".format_map,
    "dropped by the source": "{dropped_by_source}".format_map,
    "dropped by the queue": "{dropped_by_queue}".format_map,
    "lost CAN frames": "{frames_lost}".format_map,
    "lost cycles": "{cycles_lost}".format_map,
    "failures": "{failures}".format_map,
    "rate": lambda counts: f"{counts['rate_hz']:.1f} Hz" if "rate_hz" in counts else "–",
    "CPU time": "{cpu_s} s".format_map,
    "mean level": _if_estimated("{mean_level:.1f} %"),
    "mean error against the injected": _if_estimated("{mean_error:.1f} %"),
    "latency p50": lambda counts: _milliseconds(counts, "latency_p50_ns"),
    "latency p99": lambda counts: _milliseconds(counts, "latency_p99_ns"),
}


def _milliseconds(counts: dict[str, Any], name: str) -> str:
    return f"{counts[name] / 1e6:.2f} ms" if name in counts else "–"
