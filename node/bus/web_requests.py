"""What a viewer may ask for: that something be injected."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from dbc.errors import InputError
from node.outputs import SetInjection
from node.scene import Level


class InjectionRequest(BaseModel):
    """Set a kind's level (%), or give it back to the scene's schedule (None).

    ``id`` is the viewer's own and comes back with the answer.
    """

    model_config = ConfigDict(extra="forbid", strict=True)

    id: int
    sensor: str
    kind: str
    level: Level | None


class RequestError(InputError):
    """A viewer's message is no request that murk knows."""


def parse_request(text: str) -> InjectionRequest:
    """Read a viewer's message.

    Raises
    ------
    RequestError
        Naming the field that is wrong.
    """
    try:
        return InjectionRequest.model_validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"]) or "request"
        expected = 'expected {"id": N, "sensor": NAME, "kind": KIND, "level": 0 to 100 or null}'
        raise RequestError(field, first["msg"], expected) from None


def answer(request: InjectionRequest, set_injection: SetInjection) -> dict[str, Any]:
    """Do what is asked, and return the answer.

    Raises
    ------
    InputError
        If the run has no such sensor or kind, or injects nothing into the sensor.
    """
    set_injection(request.sensor, request.kind, request.level)
    return {"type": "answer", "id": request.id, "ok": True}


def refusal(error: InputError, request: InjectionRequest | None) -> dict[str, Any]:
    """Return the answer that says why not."""
    reason = {"where": error.where, "what": error.what, "remedy": error.remedy}
    return {"type": "answer", "id": request.id if request else None, "ok": False, **reason}
