"""Noise levels from ROS 2 (DDS), as ``NoiseLevel``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from time import monotonic, sleep

from dbc.errors import InputError, SceneError
from models.estimate.level import NoiseLevel
from node.bus.dds import LATCHED, RosParticipant, RosReader, domain_id, ros_name
from node.bus.messages import from_ros, typestore

TICK_S = 0.05
_POLL_S = 0.005
_TYPE = "murk_msgs/msg/NoiseLevel"


def ros2_levels(place: str, sensors: Sequence[str]) -> Iterator[NoiseLevel | None]:
    """Yield the levels of some sensors of this computer, and None where none came for a while.

    A message that is malformed is left out: it says nothing, as silence does.

    Parameters
    ----------
    place:
        ``DOMAIN/NAMESPACE``; without a domain that of ``ROS_DOMAIN_ID``, else 0.

    Raises
    ------
    InputError
        If the domain is none, or cannot be joined.
    """
    domain, _, namespace = place.partition("/")
    if domain and not domain.isdecimal():
        raise SceneError(f"ros2:{place}", "has no DDS domain", "expected ros2:DOMAIN/NAMESPACE")
    participant = RosParticipant(domain_id(int(domain) if domain else None), network=False)
    topics = [ros_name(namespace, f"/murk/{sensor}/noise_level") for sensor in sensors]
    return _taken(participant, [participant.reader(topic, _TYPE, LATCHED) for topic in topics])


def _taken(
    participant: RosParticipant, readers: Sequence[RosReader]
) -> Iterator[NoiseLevel | None]:
    heard_s = monotonic()
    while participant.dds is not None:
        levels = [level for reader in readers for level in _levels(reader)]
        if levels:
            yield from levels
            heard_s = monotonic()
        elif monotonic() - heard_s > TICK_S:
            yield None
            heard_s = monotonic()
        else:
            sleep(_POLL_S)


def _levels(reader: RosReader) -> Iterator[NoiseLevel]:
    for cdr in reader.take():
        try:
            yield from_ros(_TYPE, cdr, typestore())
        except InputError:
            continue
