"""A change of a node's state as ROS 2's managed nodes announce it."""

from __future__ import annotations

from functools import partial
from typing import Any

from rosbags.typesys.store import Typestore

from node.bus.dds import RELIABLE, RosParticipant
from node.bus.messages import serialize, typestore
from node.bus.ros2_publication import Publication
from node.events import LifecycleState, NodeState

_STATE_IDS: dict[LifecycleState, int] = {
    "unconfigured": 1,
    "inactive": 2,
    "active": 3,
    "finalized": 4,
}
"""``lifecycle_msgs/State``."""
_TRANSITIONS: dict[tuple[LifecycleState, LifecycleState], tuple[int, str]] = {
    ("unconfigured", "inactive"): (1, "configure"),
    ("inactive", "unconfigured"): (2, "cleanup"),
    ("inactive", "active"): (3, "activate"),
    ("active", "inactive"): (4, "deactivate"),
    ("unconfigured", "finalized"): (5, "shutdown"),
    ("inactive", "finalized"): (6, "shutdown"),
    ("active", "finalized"): (7, "shutdown"),
}
"""``lifecycle_msgs/Transition``."""


def transition_event(before: NodeState, after: NodeState, store: Typestore) -> Any | None:
    """Return a ``lifecycle_msgs/TransitionEvent``; None where the state has not changed."""
    transition = _TRANSITIONS.get((before.state, after.state))
    if transition is None:
        return None
    types = store.types
    state = types["lifecycle_msgs/msg/State"]
    return types["lifecycle_msgs/msg/TransitionEvent"](
        after.stamp_ns,
        types["lifecycle_msgs/msg/Transition"](*transition),
        state(_STATE_IDS[before.state], before.state),
        state(_STATE_IDS[after.state], after.state),
    )


class TransitionPublisher:
    """Publishes the changes among the states it is given on ``<node>/transition_event``.

    Parameters
    ----------
    node:
        The node's full name in ROS.
    """

    def __init__(self, participant: RosParticipant, node: str) -> None:
        self.topic = f"{node}/transition_event"
        type_name = "lifecycle_msgs/msg/TransitionEvent"
        make = partial(serialize, store=typestore())
        self.publication = Publication(participant, self.topic, type_name, RELIABLE, make)
        self._state: NodeState | None = None

    def take(self, state: NodeState) -> None:
        """Take in a heartbeat."""
        before, self._state = self._state, state
        event = transition_event(before, state, typestore()) if before is not None else None
        if event is not None:
            self.publication.send(event)
