"""Where in its life a node is, said at every change and once a second."""

from __future__ import annotations

import logging
import time
from threading import Event, Lock, Thread

from node.bus.in_process import Bus
from node.events import STATE_TOPIC, LifecycleState, NodeState

log = logging.getLogger("murk.lifecycle")

HEARTBEAT_S = 1.0
JOIN_S = 2.0


class Lifecycle:
    """A node's state, published as ``NodeState`` from the first state until ``close``.

    Parameters
    ----------
    node:
        The node's name.
    bus:
        Where to publish: ``/murk/node/state``.
    """

    def __init__(self, node: str, bus: Bus) -> None:
        self._node = node
        self._bus = bus
        self._state: LifecycleState = "unconfigured"
        self._sequence = 0
        self._lock = Lock()
        self._stop = Event()
        self._publish()
        self._heart = Thread(target=self._beat, name="murk-heartbeat", daemon=True)
        self._heart.start()

    @property
    def state(self) -> LifecycleState:
        """The node's state now."""
        return self._state

    def enter(self, state: LifecycleState) -> None:
        """Go into a state and publish it, where it is another one; ``finalized`` stays."""
        with self._lock:
            if state == self._state or self._state == "finalized":
                return
            log.info("%s: %s, was %s", self._node, state, self._state)
            self._state = state
            self._publish()

    def close(self) -> None:
        """Finalize, and end the heartbeat."""
        self.enter("finalized")
        self._stop.set()
        self._heart.join(JOIN_S)

    def _beat(self) -> None:
        while not self._stop.wait(HEARTBEAT_S):
            with self._lock:
                self._publish()

    def _publish(self) -> None:
        state = NodeState(self._node, time.time_ns(), self._state, self._sequence)
        self._sequence += 1
        self._bus.publish(STATE_TOPIC, state)
