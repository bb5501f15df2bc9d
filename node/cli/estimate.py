"""``murk estimate``: the noise level of every frame and scan of files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from node.cli.output import emit, plain_console

if TYPE_CHECKING:
    from node.batch import Row

WORST = 10


def estimate(
    paths: Annotated[list[Path], typer.Argument(help="Images, folders, videos, CAN logs, MCAP.")],
    json: Annotated[bool, typer.Option("--json", help="One JSON object a frame or scan.")] = False,
) -> None:
    """Estimate every frame and scan of files, each by itself, without a filter in time."""
    from node.batch import estimate_paths

    rows = estimate_paths(paths)
    if json:
        for row in rows:
            emit(as_record(row))
    else:
        _print(list(rows))


def as_record(row: Row) -> dict[str, Any]:
    """Return a row as the JSON object that ``murk estimate --json`` prints."""
    return {
        "type": "estimate",
        "source": row.source,
        "sequence": row.sequence,
        "stamp_ns": row.stamp_ns,
        "level": row.estimate.level,
        "std": row.estimate.std,
        "kind": row.estimate.kind,
        "probabilities": row.estimate.probabilities,
        "run_time_us": row.run_time_us,
    }


def _print(rows: list[Row]) -> None:
    """Print the distribution of the levels by source, and the worst frames and scans."""
    from rich.table import Table

    console = plain_console()
    by_source: dict[str, list[Row]] = {}
    for row in rows:
        by_source.setdefault(row.source, []).append(row)
    table = Table("source", "messages", "0–20 %", "20–50 %", "50–100 %", "mean level", "µs")
    for source, own in by_source.items():
        levels = [row.estimate.level for row in own]
        bands = [
            sum(low <= level < high for level in levels)
            for low, high in ((0, 20), (20, 50), (50, 101))
        ]
        mean_us = sum(row.run_time_us for row in own) / len(own)
        mean = sum(levels) / len(own)
        table.add_row(source, str(len(own)), *map(str, bands), f"{mean:.1f} %", f"{mean_us:.0f}")
    console.print(table)
    worst = Table("source", "sequence", "level", "± %", "kind", title="worst")
    for row in sorted(rows, key=lambda row: -row.estimate.level)[:WORST]:
        worst.add_row(
            row.source,
            str(row.sequence),
            f"{row.estimate.level:.1f} %",
            f"{row.estimate.std:.1f}",
            row.estimate.kind,
        )
    console.print(worst)
