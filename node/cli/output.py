"""How commands speak: one JSON object a line for programs, rich tables for people."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from rich.console import Console

_whole_lines = Lock()


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    raise TypeError(f"{type(value).__name__} has no JSON form")


def emit(record: Mapping[str, Any]) -> None:
    """Write one JSON object as a line on standard output; arrays become lists, dataclasses objects.

    Raises
    ------
    ValueError
        If a value is NaN or infinite, which JSON cannot say.
    """
    line = json.dumps(record, default=_plain, allow_nan=False)
    with _whole_lines:
        sys.stdout.write(line + "\n")


def plain_console(*, stderr: bool = False) -> Console:
    """Return a rich console that shows every text as it is.

    Brackets are no markup there: names, paths and ``murk[view]`` have them.
    """
    from rich.console import Console

    return Console(stderr=stderr, markup=False)
