"""What can be changed of a running node: ``murk set NODE PARAMETER VALUE``.

========================  ==========================================================
``active``                1: estimate and publish; 0: read the sensors, say nothing
``SENSOR.KIND``           level (%) of an injection, of each sensor that has one
========================  ==========================================================
"""

from __future__ import annotations

import logging
import time
from types import TracebackType
from typing import Self

from dbc.errors import SceneError
from node.bus.in_process import Bus
from node.control import ControlError, ControlServer
from node.events import EVENT_TOPIC, NodeEvent
from node.pipeline import Pipeline

log = logging.getLogger("murk.parameters")


class Parameters:
    """Takes changes of a running pipeline's parameters; a context manager.

    A node whose name another one has already runs all the same and says so; it cannot be told
    anything.

    Parameters
    ----------
    pipeline:
        What is changed.
    bus:
        Where each change is published, as a ``NodeEvent``.
    """

    def __init__(self, pipeline: Pipeline, bus: Bus) -> None:
        self._pipeline = pipeline
        self._bus = bus
        self._server: ControlServer | None = None
        try:
            self._server = ControlServer(pipeline.plan.scene.name, self.set, role="node")
        except ControlError as error:
            self._say(f"cannot be told anything while it runs: {error}")

    def set(self, name: str, value: float) -> None:
        """Change a parameter.

        Raises
        ------
        SceneError
            If there is no such parameter, or the value is impossible.
        """
        sensor, dot, kind = name.partition(".")
        if dot:
            self._pipeline.set_injection(sensor, kind, value)
        elif name != "active":
            expected = "expected 'active' or SENSOR.KIND, for example camera.noise"
            raise SceneError(name, "is no parameter of a node", expected)
        elif value not in (0, 1):
            raise SceneError(name, f"cannot be {value:g}", "expected 1 or 0")
        elif value:
            self._pipeline.activate()
        else:
            self._pipeline.deactivate()
        self._say(f"{name} = {value:g}")

    def close(self) -> None:
        """Take no more changes."""
        if self._server is not None:
            self._server.close()

    def _say(self, detail: str) -> None:
        log.info("%s", detail)
        self._bus.publish(EVENT_TOPIC, NodeEvent("parameters", time.time_ns(), detail))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
