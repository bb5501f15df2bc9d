"""What every degradation checks before it draws."""

from __future__ import annotations

import math
from collections.abc import Collection

from dbc.errors import InputError


def check_level(kind: str, level: float, kinds: Collection[str]) -> None:
    """Check what a caller asks for.

    Raises
    ------
    InputError
        If ``kind`` is not one of ``kinds``, or ``level`` is not a number from 0 to 100.
    """
    if kind not in kinds:
        raise InputError(f"kind {kind!r}", "no such degradation", f"one of {', '.join(kinds)}")
    check_within(f"level of {kind}", level, 0.0, 100.0, "%")


def check_within(where: str, value: float, low: float, high: float, unit: str) -> None:
    """Raise ``InputError`` unless ``value`` is a number from ``low`` to ``high``."""
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(where, f"{value} is out of range", f"{low:g} to {high:g} {unit}")
