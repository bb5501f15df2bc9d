"""Drawn parameters as text, and back: what a recording keeps of a degradation."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cache
from typing import TYPE_CHECKING, Any

from models.degrade.draw import DrawKey
from models.degrade.kinds import KINDS, module_of

if TYPE_CHECKING:
    from pydantic import TypeAdapter


def to_json(drawn: Any) -> str:
    """Return what a kind's ``draw`` returned as JSON; every number to its last bit."""
    return json.dumps(asdict(drawn), allow_nan=False)


def from_json(text: str) -> Any:
    """Return the drawn parameters again, equal to the first.

    Raises
    ------
    ValueError
        If the text is nothing that ``to_json`` makes.
    """
    content = json.loads(text)
    if not isinstance(content, dict):
        raise ValueError("expected a JSON object")
    return _adapter(str(content.get("kind"))).validate_python(content)


@cache
def _adapter(kind: str) -> TypeAdapter[Any]:
    """Return what reads the parameters of a kind: of the class that its ``draw`` returns."""
    from pydantic import TypeAdapter

    for sensor_type, kinds in KINDS.items():
        if kind in kinds:
            drawn = module_of(sensor_type, kind).draw(kind, 0.0, DrawKey(0, "", 0))
            return TypeAdapter(type(drawn))
    raise ValueError(f"no kind '{kind}'")
