"""The outputs of a run: each carries what the bus publishes somewhere else."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, Protocol

from node.bus.in_process import Bus
from node.plan import Plan

SetInjection = Callable[[str, str, float | None], None]
"""Changes what is injected while running (sensor, kind, level in %); ``Pipeline.set_injection``."""


class Output(Protocol):
    """A carrier of the bus's messages, open from when it is built until ``close``.

    It listens by subscriptions of its own, so that it can only delay itself; what goes wrong while
    it runs it publishes as a ``NodeEvent`` and survives.
    """

    def counts(self) -> dict[str, Any]:
        """Return what it carried and what it dropped, for the run's summary."""

    def close(self) -> None:
        """Send on what is queued, and release everything."""


@contextmanager
def open_outputs(plan: Plan, bus: Bus, set_injection: SetInjection) -> Iterator[dict[str, Output]]:
    """Open the outputs that a plan keeps, by name, and close them at the end.

    Raises
    ------
    MurkError
        If one cannot be opened; those opened before are closed.
    """
    with ExitStack() as stack:
        outputs: dict[str, Output] = {}
        for name, build in _BUILDERS.items():
            if plan.keeps(name):
                outputs[name] = output = build(plan, bus, set_injection)
                stack.callback(output.close)
        yield outputs


def _switch(plan: Plan, bus: Bus, _: SetInjection) -> Output:
    from node.switch import SwitchOutput

    return SwitchOutput(plan, bus)


def _ros2(plan: Plan, bus: Bus, set_injection: SetInjection) -> Output:
    from node.bus.ros2 import Ros2Output

    return Ros2Output(plan, bus, set_injection)


def _can(plan: Plan, bus: Bus, _: SetInjection) -> Output:
    from node.bus.can import CanOutput

    return CanOutput(plan, bus)


def _record(plan: Plan, bus: Bus, _: SetInjection) -> Output:
    from node.bus.mcap import McapRecorder

    return McapRecorder(plan, bus)


def _view(plan: Plan, bus: Bus, set_injection: SetInjection) -> Output:
    from node.bus.web import WebView

    return WebView(plan, bus, set_injection)


_BUILDERS: dict[str, Callable[[Plan, Bus, SetInjection], Output]] = {
    "record": _record,
    "ros2": _ros2,
    "can": _can,
    "view": _view,
    "switch": _switch,
}
"""In the order of opening: whoever records is there before anything is chosen or published."""
