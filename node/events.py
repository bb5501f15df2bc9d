"""What the node itself publishes, beside what it says of each sensor: see ``docs/scene.md``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

LifecycleState = Literal["unconfigured", "inactive", "active", "finalized"]
"""States of a ROS 2 managed node (design.ros2.org, "Managed nodes")."""

STATE_TOPIC = "/murk/node/state"
EVENT_TOPIC = "/murk/node/event"
MODEL_TOPIC = "/murk/model"


@dataclass(frozen=True, slots=True)
class NodeState:
    """Heartbeat: the node's lifecycle state, published at each change and once a second.

    Attributes
    ----------
    node:
        The scene's name.
    stamp_ns:
        Wall time, integer nanoseconds.
    state:
        Where in its life the node is.
    sequence:
        Counts the heartbeats from 0.
    """

    node: str
    stamp_ns: int
    state: LifecycleState
    sequence: int


@dataclass(frozen=True, slots=True)
class NodeEvent:
    """Trouble of the node that is no sensor's: a full disk, a client that floods, a bad request.

    Attributes
    ----------
    source:
        Which output or stage says it: ``record``, ``ros2``, ``can``, ``view``, ``switch``.
    stamp_ns:
        Wall time, integer nanoseconds.
    detail:
        One line for a person.
    """

    source: str
    stamp_ns: int
    detail: str


@dataclass(frozen=True, slots=True)
class ModelChoice:
    """A switch chose a model.

    Attributes
    ----------
    switch:
        The switch's name in the scene.
    stamp_ns:
        Stamp of the noise level that decided; where silence did, that of the newest level plus the
        time since, and wall time before the first; nanoseconds.
    model, previous:
        The model from now on, and the one before; empty at the first choice.
    reason:
        One line for a person: the rule and the level that decided.
    """

    switch: str
    stamp_ns: int
    model: str
    previous: str
    reason: str
