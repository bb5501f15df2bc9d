"""The results of a benchmark as tables for a person."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from models.evaluate import report
from models.evaluate.report import Goal, Point, Result, cell
from node.cli.output import plain_console


def print_results(name: str, results: Sequence[Result]) -> None:
    """Print the tables, then the points, then the goals."""
    console = plain_console()
    points = Table("variant", "knob", "run time, µs", "error", "unit", title=f"bench {name}")
    goals = Table("goal", "measured", "asked", "met")
    for result in results:
        match result:
            case Point():
                points.add_row(
                    result.variant,
                    result.knob,
                    f"{result.run_time_us:.4g}",
                    f"{result.error:.4g}",
                    result.unit,
                )
            case Goal():
                sign = "≥" if result.at_least else "≤"
                met = Text("yes", "green") if result.met else Text("no", "red")
                goals.add_row(result.name, f"{result.value:.4g}", f"{sign} {result.goal:.4g}", met)
            case report.Table():
                table = Table(*result.columns, title=result.title)
                for row in result.rows:
                    table.add_row(*map(cell, row))
                console.print(table)
    console.print(points)
    console.print(goals)
