"""The results of a benchmark as tables for a person."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from models.evaluate.report import Goal, Point


def print_results(name: str, results: Sequence[Point | Goal]) -> None:
    """Print the points, then the goals."""
    points = Table("variant", "knob", "run time, µs", "error", "unit", title=f"bench {name}")
    goals = Table("goal", "measured", "asked", "met")
    for result in results:
        if isinstance(result, Point):
            points.add_row(
                result.variant,
                result.knob,
                f"{result.run_time_us:.4g}",
                f"{result.error:.4g}",
                result.unit,
            )
        else:
            sign = "≥" if result.at_least else "≤"
            met = "[green]yes[/]" if result.met else "[red]no[/]"
            goals.add_row(result.name, f"{result.value:.4g}", f"{sign} {result.goal:.4g}", met)
    console = Console()
    console.print(points)
    console.print(goals)
