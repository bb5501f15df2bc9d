"""``murk estimate``: the noise level of every frame and scan of files."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from node.cli.output import emit, plain_console

if TYPE_CHECKING:
    from rich.table import Column

    from node.batch import Row

WORST = 10


def estimate(
    paths: Annotated[list[Path], typer.Argument(help="Images, folders, videos, CAN logs, MCAP.")],
    window: Annotated[
        bool, typer.Option("--window", help="Estimate a radar's scan with those before it.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON object a frame or scan.")] = False,
) -> None:
    """Estimate every frame and scan of files, each by itself, without a filter in time."""
    from node.batch import estimate_paths

    rows: list[Row] = []
    try:
        for row in estimate_paths(paths, window=window):
            if json:
                emit(as_record(row))
            else:
                rows.append(row)
    finally:
        if rows:
            _print(rows)


def as_record(row: Row) -> dict[str, Any]:
    """Return a row as the JSON object that ``murk estimate --json`` prints."""
    return {
        "type": "estimate",
        "source": row.source,
        "sensor": row.sensor,
        "sequence": row.sequence,
        "stamp_ns": row.stamp_ns,
        "level": row.estimate.level,
        "std": row.estimate.std,
        "kind": row.estimate.kind,
        "probabilities": row.estimate.probabilities,
        "run_time_us": row.run_time_us,
    }


def _print(rows: list[Row]) -> None:
    """Print the distribution of the levels by folder or file, and the worst frames and scans."""
    from rich.table import Table

    console = plain_console()
    groups: dict[str, list[Row]] = {}
    sensors = Counter(group for group, _ in {(row.group, row.sensor) for row in rows})
    for row in rows:
        name = f"{row.group} {row.sensor}" if sensors[row.group] > 1 else row.group
        groups.setdefault(name, []).append(row)
    table = Table(_source(), "messages", "0–20 %", "20–50 %", "50–100 %", "mean level", "µs")
    for group, own in groups.items():
        levels = [row.estimate.level for row in own]
        bands = [
            sum(low <= level < high for level in levels)
            for low, high in ((0, 20), (20, 50), (50, 101))
        ]
        mean_us = sum(row.run_time_us for row in own) / len(own)
        mean = sum(levels) / len(own)
        table.add_row(group, str(len(own)), *map(str, bands), f"{mean:.1f} %", f"{mean_us:.0f}")
    console.print(table)
    worst = Table(_source(), "sequence", "level", "± %", "kind", title="worst")
    for row in sorted(rows, key=lambda row: -row.estimate.level)[:WORST]:
        worst.add_row(
            row.source,
            str(row.sequence),
            f"{row.estimate.level:.1f} %",
            f"{row.estimate.std:.1f}",
            row.estimate.kind,
        )
    console.print(worst)


def _source() -> Column:
    """Return a column for paths, which are shown whole however narrow the terminal is."""
    from rich.table import Column

    return Column("source", overflow="fold")
