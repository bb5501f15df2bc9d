"""Points and goals of a benchmark: what ``murk bench`` prints and writes."""

from __future__ import annotations

from dataclasses import dataclass


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
    """

    variant: str
    knob: str
    run_time_us: float
    error: float
    unit: str


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
