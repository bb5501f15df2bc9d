"""Points, goals, tables and pictures of a benchmark: what ``murk bench`` prints and writes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Point:
    """One variant of a thing with a knob, measured.

    Attributes
    ----------
    variant:
        What was measured, e.g. ``"blur, shrink 4"``.
    knob:
        The knob and its value, e.g. ``"level=50"``.
    run_time_us:
        Run time of one call, microseconds (median).
    error:
        Error of its result, in ``unit``; 0 where the result is exact.
    unit:
        Unit of the error.
    shipped:
        True where it is what murk does by default. Where a unit has such a point, its points are
        rivals for one task: the page marks those that no other beats in both time and error.
    """

    variant: str
    knob: str
    run_time_us: float
    error: float
    unit: str
    shipped: bool = False


@dataclass(frozen=True, slots=True)
class Goal:
    """A goal, and whether this run met it.

    Attributes
    ----------
    name:
        What is asked, with its unit, e.g. ``"decode, times cantools"``.
    value:
        What was measured.
    goal:
        The bound.
    at_least:
        True where larger is better, False where smaller is.
    """

    name: str
    value: float
    goal: float
    at_least: bool = True

    @property
    def met(self) -> bool:
        """Whether the value is on the right side of the bound."""
        return self.value >= self.goal if self.at_least else self.value <= self.goal


@dataclass(frozen=True, slots=True)
class Table:
    """Figures in rows and columns; the first column names the row."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | int | float, ...], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A plot for the page: ``draw`` is given an empty figure, 9 × 5 inches."""

    title: str
    draw: Callable[[Figure], None]


Result = Point | Goal | Table | Picture


def on_front(points: Sequence[Point]) -> list[bool]:
    """Tell of each point whether no other is at least as fast and as near, and better in one."""
    return [
        not any(
            other.run_time_us <= point.run_time_us
            and other.error <= point.error
            and (other.run_time_us, other.error) != (point.run_time_us, point.error)
            for other in points
        )
        for point in points
    ]


def cell(value: str | float) -> str:
    """Return a table's entry as text: numbers in four digits."""
    return value if isinstance(value, str) else f"{value:.4g}"


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str | float]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    return lines + [f"| {' | '.join(map(cell, row))} |" for row in rows]
