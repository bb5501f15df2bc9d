"""Writes a benchmark's report: a page with its tables, and a plot of error against run time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from models.evaluate.report import Goal, Picture, Point, Result, Table, cell, markdown, on_front

MOST_LABELS = 20
"""Points in a plot up to which each is labelled with its knob."""


def write_report(
    name: str, description: str, results: Sequence[Result], folder: Path
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
    for result in results:
        if isinstance(result, Table):
            lines += ["", f"## {result.title}", "", *markdown(result.columns, result.rows)]
        elif isinstance(result, Picture):
            plots.append(_draw(result, folder / f"{name}-{len(plots) + 1}.png"))
            lines += ["", f"## {result.title}", "", f"![{result.title}]({plots[-1].name})"]
    lines += ["", "## All points", "", *markdown(*_points_table(points))]
    page = folder / f"{name}.md"
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [page, *plots]


def _points_table(points: Sequence[Point]) -> tuple[list[str], list[list[str | float]]]:
    """Return columns and rows; a bold error is on the front of its unit, where there is one."""
    columns = ["variant", "knob", "run time, µs", "error", "unit"]
    best = {id(point) for _, own in _rivals(points) for point in own}
    rows: list[list[str | float]] = [
        [
            f"{point.variant} (default)" if point.shipped else point.variant,
            point.knob,
            point.run_time_us,
            f"**{cell(point.error)}**" if id(point) in best else point.error,
            point.unit,
        ]
        for point in points
    ]
    return columns, rows


def _rivals(points: Sequence[Point]) -> list[tuple[str, list[Point]]]:
    """Return, for every unit that has a shipped point, the points on its front by run time."""
    fronts = []
    for unit in dict.fromkeys(point.unit for point in points if point.shipped):
        own = [point for point in points if point.unit == unit]
        front = [point for point, best in zip(own, on_front(own), strict=True) if best]
        fronts.append((unit, sorted(front, key=lambda point: point.run_time_us)))
    return fronts


def _draw(picture: Picture, path: Path) -> Path:
    figure = plt.figure(figsize=(9, 5))
    picture.draw(figure)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


def _plot_files(name: str, points: Sequence[Point]) -> dict[str, str]:
    """Return the plot's file name for each unit of error, for units share no axis.

    Points of one unit that all take the same time are no curve, and have no plot.
    """
    run_times: dict[str, list[float]] = {}
    for point in points:
        run_times.setdefault(point.unit, []).append(point.run_time_us)
    units = [unit for unit, own in run_times.items() if len(own) == 1 or len(set(own)) > 1]
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
    for _, front in _rivals(points):
        axis.step(
            [point.run_time_us for point in front],
            [point.error for point in front],
            where="post",
            color="0.6",
            linestyle=":",
            label="front",
        )
        axis.plot(
            [point.run_time_us for point in points if point.shipped],
            [point.error for point in points if point.shipped],
            "k*",
            markersize=15,
            label="default",
        )
    axis.set_ylabel(f"error, {unit}")
    axis.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))


def _variants(points: Sequence[Point]) -> list[str]:
    return list(dict.fromkeys(point.variant for point in points))
