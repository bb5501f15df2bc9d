"""Levels over time: pure functions of the time since a sensor's first message.

Each schedule is a small frozen dataclass with ``level_at(t_s)``: the same answer for the same
time, whatever was asked before. Before 0 s it is what it is at 0 s.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from itertools import pairwise
from statistics import NormalDist
from typing import Protocol

from dbc.errors import InputError
from models.degrade.checks import check_within

_FINEST_S = 1e-12
"""Below this interval the walk is a straight line."""

_NORMAL = NormalDist()


class Schedule(Protocol):
    """A level over time."""

    def level_at(self, t_s: float) -> float:
        """Return the level, %, ``t_s`` seconds after the first message."""


def _time(t_s: float) -> float:
    if not math.isfinite(t_s):
        raise InputError("time", f"{t_s} s is no time", "a number of seconds")
    return max(0.0, t_s)


def _check_level(level: float) -> None:
    check_within("level", level, 0.0, 100.0, "%")


def _check_seconds(where: str, seconds: float) -> None:
    check_within(where, seconds, 1e-9, 1e12, "s")


def _check_points(points: tuple[tuple[float, float], ...]) -> None:
    if not points:
        raise InputError("points", "none", "at least one (time, level)")
    for time, level in points:
        check_within("time", time, 0.0, 1e12, "s")
        _check_level(level)
    if any(later < earlier for (earlier, _), (later, _) in pairwise(points)):
        raise InputError("points", "the times decrease", "times in order")


@dataclass(frozen=True, slots=True)
class Constant:
    """The same level always."""

    level: float

    def __post_init__(self) -> None:
        _check_level(self.level)

    def level_at(self, t_s: float) -> float:
        """Return the level, %."""
        _time(t_s)
        return self.level


@dataclass(frozen=True, slots=True)
class Step:
    """The level of the last of the points (s, %) that has come; 0 before the first."""

    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        _check_points(self.points)

    def level_at(self, t_s: float) -> float:
        """Return the level, %, at a time in s."""
        now = _time(t_s)
        return next((level for time, level in reversed(self.points) if time <= now), 0.0)


@dataclass(frozen=True, slots=True)
class Ramp:
    """Straight lines between the points (s, %); 0 before the first, constant after the last."""

    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        _check_points(self.points)

    def level_at(self, t_s: float) -> float:
        """Return the level, %, at a time in s."""
        now = _time(t_s)
        if now < self.points[0][0]:
            return 0.0
        for (start, first), (end, last) in pairwise(self.points):
            if start <= now < end:
                share = (now - start) / (end - start)
                return first * (1.0 - share) + last * share
        return self.points[-1][1]


@dataclass(frozen=True, slots=True)
class Burst:
    """``level`` for ``duration_s`` at the start of every ``period_s``, else ``rest``."""

    level: float
    duration_s: float
    period_s: float
    rest: float = 0.0

    def __post_init__(self) -> None:
        _check_level(self.level)
        _check_level(self.rest)
        _check_seconds("period_s", self.period_s)
        check_within("duration_s", self.duration_s, 0.0, self.period_s, "s")

    def level_at(self, t_s: float) -> float:
        """Return the level, %, at a time in s."""
        return self.level if _time(t_s) % self.period_s < self.duration_s else self.rest


@dataclass(frozen=True, slots=True)
class RandomWalk:
    """Brownian motion between two reflecting bounds, exact at any time and any time step.

    Lévy's construction: the walk's value in the middle of an interval is that of its ends' mean
    plus an independent normal of variance (length / 4) × rate², drawn from a hash of the interval.
    So the path depends on the seed alone, not on when it is looked at. A Brownian motion folded
    between two mirrors is one reflected at them.

    Attributes
    ----------
    start:
        Level at 0 s, %.
    rate:
        Standard deviation after one second, far from the bounds, %/√s.
    low, high:
        The bounds, %.
    """

    seed: int
    start: float
    rate: float
    low: float = 0.0
    high: float = 100.0

    def __post_init__(self) -> None:
        for level in (self.low, self.high):
            _check_level(level)
        if self.low >= self.high:
            raise InputError("bounds", f"{self.low} is not below {self.high}", "low below high")
        check_within("start", self.start, self.low, self.high, "%")
        check_within("rate", self.rate, 0.0, 1e6, "%/√s")

    def level_at(self, t_s: float) -> float:
        """Return the level, %, at a time in s."""
        free = self.start - self.low + self.rate * self._brownian(_time(t_s))
        span = self.high - self.low
        folded = math.fmod(abs(free), 2.0 * span)
        return self.low + (folded if folded <= span else 2.0 * span - folded)

    def _normal(self, start: float, length: float) -> float:
        """Return the standard normal that belongs to an interval."""
        text = f"{self.seed}\0{start.hex()}\0{length.hex()}".encode()
        number = int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "little")
        return _NORMAL.inv_cdf(((number >> 12) + 0.5) * 2.0**-52)

    def _brownian(self, time: float) -> float:
        """Return the standard Brownian motion: double to an interval with ``time``, then halve."""
        start, length, first = 0.0, 1.0, 0.0
        last = self._normal(0.0, 1.0)
        while time > start + length:
            start, first = start + length, last
            length = start
            last = first + math.sqrt(length) * self._normal(start, length)
        while length > _FINEST_S and start < time < start + length:
            length /= 2
            middle = (first + last) / 2 + math.sqrt(length / 2) * self._normal(start, length)
            if time < start + length:
                last = middle
            else:
                start, first = start + length, middle
        share = (time - start) / length
        return first * (1.0 - share) + last * share
