"""Requests for injections that come over ROS 2."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from dbc.errors import InputError
from node.bus.dds import RosReader
from node.bus.messages import from_ros, typestore

if TYPE_CHECKING:
    from node.outputs import SetInjection

SAY_PERIOD_S = 1.0
"""Refusals are said at most so often, with how many there were."""


class InjectionRequests:
    """Carries out what ``/murk/<sensor>/inject`` asks for; refuses what is malformed or impossible.

    Parameters
    ----------
    readers:
        By sensor.
    set_injection:
        Carries a request out, or raises ``InputError``.
    say:
        Called with a line for a person.

    Attributes
    ----------
    accepted, refused:
        Requests so far.
    """

    def __init__(
        self,
        readers: Mapping[str, RosReader],
        set_injection: SetInjection,
        say: Callable[[str], None],
    ) -> None:
        self.accepted = self.refused = 0
        self._readers = readers
        self._set_injection = set_injection
        self._say = say
        self._unsaid = 0
        self._reason = ""
        self._said_s = float("-inf")

    def poll(self) -> None:
        """Carry out what has come."""
        for sensor, reader in self._readers.items():
            for cdr in reader.take():
                try:
                    request = from_ros(reader.type_name, cdr, typestore())
                    self._set_injection(sensor, request.kind, request.level)
                except InputError as error:
                    self.refused += 1
                    self._unsaid += 1
                    self._reason = f"{sensor}: {error}"
                else:
                    self.accepted += 1
        now_s = time.monotonic()
        if self._unsaid and now_s - self._said_s >= SAY_PERIOD_S:
            requests = "an injection" if self._unsaid == 1 else f"{self._unsaid} injections"
            self._say(f"refused {requests} into {self._reason}")
            self._unsaid, self._said_s = 0, now_s

    def close(self) -> None:
        """Take no more."""
        for reader in self._readers.values():
            reader.close()
