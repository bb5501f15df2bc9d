"""DDS as ROS 2 uses it: names, types, QoS and bytes, without a ROS installation.

Topics, types and QoS are named as ``rmw`` names them, so that a node of ROS 2 sees topics of its
own kind. What is written is CDR that was made before (``node.bus.messages``); DDS only carries it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from functools import cache
from typing import Any
from weakref import WeakValueDictionary

from rosbags.interfaces import Nodetype

from dbc.errors import InputError, MissingExtra
from node.bus.messages import typestore

try:
    from cyclonedds.core import (
        DDSException,
        InstanceState,
        ReadCondition,
        SampleState,
        ViewState,
        WaitSet,
    )
    from cyclonedds.domain import Domain, DomainParticipant
    from cyclonedds.idl import make_idl_struct, types
    from cyclonedds.internal import InvalidSample
    from cyclonedds.pub import DataWriter
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
except ImportError:
    raise MissingExtra("ros2", "ROS 2 (--ros2)") from None

MAX_DOMAIN = 232
"""Beyond it the ports of RTPS (7400 + 250 × domain) do not exist."""
_LOOPBACK = """<CycloneDDS><Domain Id="any">
<General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
<Peers><Peer Address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""
"""As ROS 2 does with ``ROS_LOCALHOST_ONLY``: who else is there is found by trying its ports."""
_LINGER = """<CycloneDDS><Domain Id="any">
<Internal><WriterLingerDuration>100 ms</WriterLingerDuration></Internal>
</Domain></CycloneDDS>"""
"""How long each topic's end waits for a reader that has stopped reading."""
_BLOCK_NS = 10_000_000
"""How long a reliable write may wait for a reader that does not keep up."""

_XCDR1 = Policy.DataRepresentation(use_cdrv0_representation=True)
SENSOR_DATA = Qos(
    Policy.Reliability.BestEffort,
    Policy.Durability.Volatile,
    Policy.History.KeepLast(5),
    _XCDR1,
)
LATCHED = Qos(
    Policy.Reliability.Reliable(max_blocking_time=_BLOCK_NS),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(10),
    Policy.DurabilityService(0, Policy.History.KeepLast(1), -1, -1, -1),
    _XCDR1,
)
"""Reliable: a reader may be ten behind, and late joiners get the last value alone."""
RELIABLE = Qos(
    Policy.Reliability.Reliable(max_blocking_time=_BLOCK_NS),
    Policy.Durability.Volatile,
    Policy.History.KeepLast(10),
    _XCDR1,
)
"""What ROS 2 takes by default."""

_open_domains: WeakValueDictionary[tuple[int, bool], Any] = WeakValueDictionary()
"""Domains of this process, by number and ``network``: however many take part, each opens once."""


def domain_id(wanted: int | None) -> int:
    """Return the DDS domain: the one that is wanted, else that of ``ROS_DOMAIN_ID``, else 0.

    Raises
    ------
    InputError
        If that is no domain.
    """
    expected = f"expected an integer from 0 to {MAX_DOMAIN}"
    if wanted is not None:
        if not 0 <= wanted <= MAX_DOMAIN:
            raise InputError(f"DDS domain {wanted}", "does not exist", expected)
        return wanted
    text = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not re.fullmatch(r"[0-9]{1,9}", text) or int(text) > MAX_DOMAIN:
        raise InputError("ROS_DOMAIN_ID", f"'{text}' is no DDS domain", expected)
    return int(text)


def ros_name(namespace: str, topic: str) -> str:
    """Return a topic's full name in ROS."""
    parts = f"{namespace}/{topic}".split("/")
    return "/" + "/".join(part for part in parts if part)


def node_name(scene: str) -> str:
    """Return the node's name in ROS, where a name is a word of ASCII."""
    return "murk_" + re.sub(r"[^a-zA-Z0-9_]", "_", scene)


class RosParticipant:
    """Takes part in a DDS domain.

    Parameters
    ----------
    domain:
        0 to 232.
    network:
        False: only this computer. True: as ``CYCLONEDDS_URI`` says, by default the whole network.

    Raises
    ------
    InputError
        If the domain cannot be joined.
    """

    def __init__(self, domain: int, *, network: bool) -> None:
        try:
            self._domain = _open_domain(domain, network)
            enclave = Policy.Userdata(b"enclave=/;")  # by which ROS 2 knows its own
            self.dds: Any = DomainParticipant(domain, Qos(enclave))
        except DDSException as error:
            remedy = "see CYCLONEDDS_URI" if network else "does this process have it open already?"
            what = f"cannot be joined: {_reason(error)}"
            raise InputError(f"DDS domain {domain}", what, remedy) from None

    def writer(self, topic: str, type_name: str, qos: Any) -> RosWriter:
        """Announce a topic (its name in ROS) and its type, e.g. ``murk_msgs/msg/NoiseLevel``."""
        return RosWriter(DataWriter(self.dds, self._topic(topic, type_name), qos))

    def reader(self, topic: str, type_name: str, qos: Any) -> RosReader:
        """Subscribe to a topic."""
        return RosReader(DataReader(self.dds, self._topic(topic, type_name), qos), type_name)

    def close(self) -> None:
        """Leave the domain, once all writers and readers are closed."""
        self.dds = self._domain = None

    def _topic(self, topic: str, type_name: str) -> Any:
        return Topic(self.dds, f"rt{topic}", _struct(type_name, raw=True))


class RosWriter:
    """Writes CDR bytes on one topic."""

    def __init__(self, dds: Any) -> None:
        self.dds = dds

    def matched(self) -> int:
        """Return how many readers there are now."""
        return int(self.dds.get_publication_matched_status().current_count)

    def write(self, cdr: bytes) -> bool:
        """Send a message; False where a reader kept it waiting for too long and it was dropped.

        Raises
        ------
        ValueError
            If the bytes are no message of the topic's type.
        """
        try:
            self.dds.write(self.dds.data_type(cdr))
        except DDSException as error:
            if error.code == DDSException.DDS_RETCODE_TIMEOUT:
                return False
            raise ValueError(_reason(error)) from None
        return True

    def close(self) -> None:
        """Withdraw the topic."""
        self.dds = None


class RosReader:
    """Takes CDR bytes from one topic.

    Attributes
    ----------
    type_name:
        The ROS type, e.g. ``murk_msgs/msg/Injection``.
    """

    def __init__(self, dds: Any, type_name: str) -> None:
        self.dds = dds
        self.type_name = type_name

    def take(self) -> list[bytes]:
        """Return the messages that have come, oldest first, without waiting."""
        return [sample.cdr for sample in self.dds.take(64) if not isinstance(sample, InvalidSample)]

    def close(self) -> None:
        """Unsubscribe."""
        self.dds = None


class RosWaiter:
    """Waits until one of some readers has a message."""

    def __init__(self, participant: RosParticipant, readers: Iterable[RosReader]) -> None:
        anything = SampleState.Any | ViewState.Any | InstanceState.Any
        self._waitset: Any = WaitSet(participant.dds)
        for reader in readers:
            self._waitset.attach(ReadCondition(reader.dds, anything))

    def wait(self, timeout_s: float) -> bool:
        """Return whether there is something to take."""
        return bool(self._waitset.wait(round(timeout_s * 1e9)))

    def close(self) -> None:
        """Wait no longer; the readers stay open."""
        self._waitset = None


def _open_domain(domain: int, network: bool) -> Any:
    found = _open_domains.get((domain, network))
    if found is None:
        how = os.environ.get("CYCLONEDDS_URI", "") if network else _LOOPBACK
        found = _open_domains[domain, network] = Domain(domain, f"{how},{_LINGER}".strip(","))
    return found


def _reason(error: DDSException) -> str:
    """Return what DDS says of an error, without its code and the place where it occurred."""
    _, _, text = str(error).partition("] ")
    return text.partition(". ")[0].lower()


_IDL: Any = types
_BASES: dict[str, Any] = {"bool": bool, "string": str, "byte": types.byte, "char": types.uint8}


@cache
def _struct(type_name: str, *, raw: bool = False) -> Any:
    """Return a message's type as DDS declares it; where ``raw``, a sample is its CDR bytes."""
    package, _, name = type_name.split("/")
    _, fields = typestore().fielddefs[type_name]
    struct: Any = make_idl_struct(
        f"{name}_",
        f"{package}.msg.dds_.{name}_",
        {field: _member(described) for field, described in fields},
        dataclassify=False,
    )
    if raw:
        struct.__init__ = _keep
        struct.serialize = lambda sample, use_version_2=None: sample.cdr
        struct.deserialize = classmethod(lambda cls, data: cls(bytes(data)))
        struct.deserialize_key = struct.deserialize  # of samples that only say "disposed"
    return struct


def _keep(sample: Any, cdr: bytes) -> None:
    sample.cdr = cdr


def _member(described: Any) -> Any:
    kind, content = described
    if kind == Nodetype.NAME:
        return _struct(content)
    if kind == Nodetype.ARRAY:
        return _IDL.array[_member(content[0]), content[1]]
    if kind == Nodetype.SEQUENCE:
        return _IDL.sequence[_member(content[0])]
    return _BASES.get(content[0]) or getattr(_IDL, content[0])
