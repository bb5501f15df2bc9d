"""Noise levels, diagnostics and, where the scene asks, scans and images over ROS 2 (DDS).

Topics, types and QoS: ``docs/ros2.md``.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

from node.bus.dds import RELIABLE, RosParticipant, domain_id, node_name, ros_name
from node.bus.in_process import Bus
from node.bus.messages import InjectionRequest, type_name_of
from node.bus.ros2_carrier import Carrier
from node.bus.ros2_diagnostics import DiagnosticsPublisher
from node.bus.ros2_publication import Publication
from node.bus.ros2_requests import InjectionRequests
from node.bus.ros2_rivals import Rivals
from node.bus.ros2_topics import Carried, data_topics, level_topics
from node.bus.ros2_transitions import TransitionPublisher
from node.events import EVENT_TOPIC, NodeEvent, NodeState
from node.plan import Plan

if TYPE_CHECKING:
    from node.outputs import SetInjection

log = logging.getLogger("murk.ros2")


class Ros2Output:
    """Carries the bus to ROS 2, and requests for injections from it.

    One thread carries levels and all else that is small, another one scans and images, so that no
    level waits for a JPEG.

    Parameters
    ----------
    plan:
        Whose scene has ``outputs.ros2``.
    bus:
        What is carried.
    set_injection:
        Called with what ``/murk/<sensor>/inject`` asks for.

    Raises
    ------
    InputError
        If ``ROS_DOMAIN_ID`` is no domain, or the domain cannot be joined.
    """

    def __init__(self, plan: Plan, bus: Bus, set_injection: SetInjection) -> None:
        settings = plan.scene.outputs.ros2
        assert settings is not None, "plan() keeps this output where the scene asks for it"
        sensors = plan.scene.sensors
        self._bus = bus
        self._domain = domain_id(settings.domain)
        self._participant = RosParticipant(self._domain, network=settings.network)
        name = partial(ros_name, settings.namespace)
        node = name(node_name(plan.scene.name))
        levels = [name(f"/murk/{sensor.name}/noise_level") for sensor in sensors]
        self._transitions = TransitionPublisher(self._participant, node)
        self._rivals = Rivals(self._participant, [self._transitions.topic, *levels], self._say)
        self._diagnostics = DiagnosticsPublisher(
            self._participant, node, sensors, lambda: self._rivals.topics
        )
        self._requests = InjectionRequests(
            {
                sensor.name: self._participant.reader(
                    name(f"/murk/{sensor.name}/inject"), type_name_of(InjectionRequest), RELIABLE
                )
                for sensor in sensors
            },
            set_injection,
            self._say,
        )
        self._failed = 0
        self._carriers = [Carrier(bus, self._open(level_topics(sensors), name), self._serve)]
        if data := self._open(data_topics(sensors, settings), name):
            self._carriers.append(Carrier(bus, data))

    def counts(self) -> dict[str, Any]:
        """Return the domain, and what was sent, dropped, refused and met there."""
        publications = self._all()
        late = [carrier.dropped for carrier in self._carriers]
        return {
            "domain": self._domain,
            "sent": sum(one.sent for one in publications),
            "dropped": sum(one.dropped for one in publications) + sum(late),
            "failed": sum(one.failed for one in publications) + self._failed,
            "injections": self._requests.accepted,
            "injections_refused": self._requests.refused,
            "rivals": self._rivals.seen,
        }

    def readers(self, topic: str) -> int:
        """Return how many readers a topic has; both by the topic's full name in ROS."""
        return sum(one.readers() for one in self._all() if one.topic == topic)

    def close(self) -> None:
        """Send on what is queued, and leave the domain."""
        for carrier in self._carriers:
            carrier.close()
        for one in (self._diagnostics.publication, self._transitions.publication):
            one.close()
        self._requests.close()
        self._rivals.close()
        self._participant.close()

    def _all(self) -> list[Publication]:
        publications = [one for carrier in self._carriers for one in carrier.publications]
        return [*publications, self._diagnostics.publication, self._transitions.publication]

    def _open(
        self, topics: Iterable[Carried], name: Callable[[str], str]
    ) -> dict[str, list[Publication]]:
        publications: dict[str, list[Publication]] = {}
        for source, topic, type_name, qos, make in topics:
            one = Publication(self._participant, name(topic), type_name, qos, make)
            publications.setdefault(source, []).append(one)
        return publications

    def _serve(self, messages: Iterable[Any]) -> None:
        """Do what is to be done beside carrying levels; a failure of it must not stop those."""
        try:
            for message in messages:
                self._diagnostics.take(message)
                if isinstance(message, NodeState):
                    self._transitions.take(message)
            self._requests.poll()
            self._rivals.poll()
            self._diagnostics.poll()
        except Exception:
            self._failed += 1
            if self._failed == 1:
                log.exception("beside the levels something failed; further failures are counted")

    def _say(self, detail: str) -> None:
        log.info("%s", detail)
        self._bus.publish(EVENT_TOPIC, NodeEvent("ros2", time.time_ns(), detail))
