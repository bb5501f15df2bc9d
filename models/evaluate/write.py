"""Writes a benchmark's report: a page with its tables, and a plot of error against run time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from models.evaluate.report import Goal, Point

MOST_LABELS = 20
"""Points in a plot up to which each is labelled with its knob."""


def write_report(
    name: str, description: str, results: Sequence[Point | Goal], folder: Path
) -> list[Path]:
    """Write ``NAME.md`` and its plots into a folder; return the files.

    Parameters
    ----------
    description:
        What was measured, as the page's text.
    """
    folder.mkdir(parents=True, exist_ok=True)
    points = [result for result in results if isinstance(result, Point)]
    goals = [result for result in results if isinstance(result, Goal)]
    plots = [
        _plot([point for point in points if point.unit == unit], unit, folder / file)
        for unit, file in _plot_files(name, points).items()
    ]
    lines = [f"# {name}", "", description.strip(), "", f"Printed by `murk bench {name}`.", ""]
    lines += [f"![error against run time]({plot.name})\n" for plot in plots]
    lines += ["| goal | measured | asked | met |", "|---|---|---|---|"]
    lines += [
        f"| {goal.name} | {goal.value:.4g} | {'≥' if goal.at_least else '≤'} {goal.goal:.4g} "
        f"| {'yes' if goal.met else '**no**'} |"
        for goal in goals
    ]
    lines += ["", "| variant | knob | run time, µs | error | unit |", "|---|---|---|---|---|"]
    lines += [
        f"| {point.variant} | {point.knob} | {point.run_time_us:.4g} | {point.error:.4g} "
        f"| {point.unit} |"
        for point in points
    ]
    page = folder / f"{name}.md"
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [page, *plots]


def _plot_files(name: str, points: Sequence[Point]) -> dict[str, str]:
    """Return the plot's file name for each unit of error, for units share no axis."""
    units = list(dict.fromkeys(point.unit for point in points))
    return {unit: f"{name}-{number}.png" for number, unit in enumerate(units, start=1)}


def _plot(points: Sequence[Point], unit: str, path: Path) -> Path:
    exact = all(point.error == 0 for point in points)
    figure, axis = plt.subplots(figsize=(9, max(3.0, 0.28 * len(points))) if exact else (9, 5))
    if exact:
        _draw_run_times(axis, points, unit)
    else:
        _draw_front(axis, points, unit)
    axis.set_xscale("log")
    axis.set_xlabel("run time, µs")
    axis.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


def _draw_run_times(axis: Axes, points: Sequence[Point], unit: str) -> None:
    """Draw a bar a point, where no error tells them apart."""
    names = [f"{point.variant}, {point.knob}" for point in points]
    colours = {variant: f"C{n}" for n, variant in enumerate(_variants(points))}
    axis.barh(
        range(len(points)),
        [point.run_time_us for point in points],
        color=[colours[point.variant] for point in points],
    )
    axis.set_yticks(range(len(points)), names, size=8)
    axis.invert_yaxis()
    axis.set_title(f"error 0 everywhere ({unit})", loc="left", size=9)


def _draw_front(axis: Axes, points: Sequence[Point], unit: str) -> None:
    """Draw error over run time, a line a variant; labels where they have room."""
    for variant in _variants(points):
        own = [point for point in points if point.variant == variant]
        axis.plot(
            [point.run_time_us for point in own],
            [point.error for point in own],
            marker="o",
            label=variant,
        )
        for point in own if len(points) <= MOST_LABELS else ():
            axis.annotate(
                point.knob,
                (point.run_time_us, point.error),
                xytext=(5, 0),
                textcoords="offset points",
                size=7,
            )
    axis.set_ylabel(f"error, {unit}")
    axis.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))


def _variants(points: Sequence[Point]) -> list[str]:
    return list(dict.fromkeys(point.variant for point in points))
