"""Which topics of ROS 2 are published in a DDS domain."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException
from cyclonedds.qos import Policy

from node.bus.dds import LATCHED, SENSOR_DATA, RosParticipant


class PublishedTopic(NamedTuple):
    """A topic and its type as ROS names them, and the QoS with which all of it can be heard."""

    name: str
    type_name: str
    qos: Any


def published_topics(participant: RosParticipant) -> Callable[[], Iterator[PublishedTopic]]:
    """Return a function that yields the topics announced since its last call.

    Names are those of ROS: ``/murk/front/noise_level``, ``murk_msgs/msg/NoiseLevel``. What is not
    of ROS is left out.
    """
    announced = BuiltinDataReader(participant.dds, BuiltinTopicDcpsPublication)

    def new() -> Iterator[PublishedTopic]:
        try:
            samples = announced.take(100)
        except DDSException:  # nothing yet
            return
        for sample in samples:
            topic = getattr(sample, "topic_name", "")
            parts = getattr(sample, "type_name", "").split("::")
            if topic.startswith("rt/") and len(parts) == 4 and parts[2] == "dds_":
                type_name = f"{parts[0]}/{parts[1]}/{parts[3].removesuffix('_')}"
                latched = Policy.Durability.TransientLocal in sample.qos
                yield PublishedTopic(topic[2:], type_name, LATCHED if latched else SENSOR_DATA)

    return new
