"""What a carrier carries, topic by topic: DDS, CAN and recordings, for ``murk watch``."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from dbc.errors import SceneError

if TYPE_CHECKING:
    from node.bus.can_levels import CanLevel
    from node.bus.dds import RosReader

RATE_OVER = 30
"""Messages from which a topic's rate is told."""


class Heard(NamedTuple):
    """One message: its topic and type, when it came (wall time, ns), and a line for a person."""

    topic: str
    type_name: str
    time_ns: int
    text: str


class Carrier(Protocol):
    """Where messages are heard."""

    def heard(self, timeout_s: float) -> list[Heard] | None:
        """Return what has come, waiting up to ``timeout_s``; None where nothing more will come.

        Raises
        ------
        MurkError
            If the carrier turns out broken.
        """

    def close(self) -> None:
        """Release what is open."""


def open_carrier(source: str) -> Carrier:
    """Open a carrier by name: ``ros2:`` or ``ros2:DOMAIN``, ``can:BUS``, or an MCAP file.

    Raises
    ------
    InputError
        If it is none of these, or cannot be opened.
    """
    name, _, rest = source.partition(":")
    if Path(source).suffix == ".mcap":
        return McapCarrier(Path(source))
    if name == "can" and rest:
        return CanCarrier(rest)
    if name == "ros2" and (not rest or rest.isdecimal()):
        return Ros2Carrier(int(rest) if rest else None)
    raise SceneError(source, "is no carrier", "expected ros2:, ros2:DOMAIN, can:BUS or FILE.mcap")


@dataclass(slots=True)
class TopicView:
    """What was heard of one topic: how many messages, the newest, and when the last ones came."""

    type_name: str
    count: int = 0
    text: str = ""
    times_ns: deque[int] = field(default_factory=lambda: deque(maxlen=RATE_OVER))

    def add(self, heard: Heard) -> None:
        """Take in a message."""
        self.count += 1
        self.text = heard.text
        self.times_ns.append(heard.time_ns)

    @property
    def rate_hz(self) -> float | None:
        """Messages a second, over the last ones; None while there are fewer than two."""
        span_ns = self.times_ns[-1] - self.times_ns[0]
        return 1e9 * (len(self.times_ns) - 1) / span_ns if span_ns > 0 else None


class CanCarrier:
    """Levels on a CAN bus; a topic is an identifier, for CAN carries no names."""

    def __init__(self, bus: str) -> None:
        from node.bus.can_levels import LevelReader

        self._reader = LevelReader(bus)

    def heard(self, timeout_s: float) -> list[Heard]:
        """See ``Carrier``."""
        return [
            Heard(f"0x{level.can_id:X}", "NoiseLevel", level.stamp_ns, _can_text(level))
            for level in self._reader.read(timeout_s)
        ]

    def close(self) -> None:
        """See ``Carrier``."""
        self._reader.close()


class McapCarrier:
    """All messages of a recording, at once."""

    def __init__(self, path: Path) -> None:
        from node.bus.mcap_reader import open_mcap

        self._recording: Any = open_mcap(path)
        self._done = False

    def heard(self, timeout_s: float) -> list[Heard] | None:
        """See ``Carrier``; a recording does not keep anybody waiting."""
        if self._done:
            return None
        self._done = True
        return [
            Heard(one.topic, one.type_name, one.log_time, describe(one.type_name, one.cdr))
            for one in self._recording.entries()
        ]

    def close(self) -> None:
        """See ``Carrier``."""


class Ros2Carrier:
    """Every topic of a DDS domain whose type murk knows, found while it listens."""

    LOOK_S = 0.5

    def __init__(self, domain: int | None) -> None:
        from node.bus.dds import RosParticipant, domain_id
        from node.bus.dds_topics import published_topics

        self._participant = RosParticipant(domain_id(domain), network=False)
        self._published = published_topics(self._participant)
        self._readers: dict[str, RosReader] = {}
        self._looked_s = 0.0

    def heard(self, timeout_s: float) -> list[Heard]:
        """See ``Carrier``."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            self._look_for_topics()
            taken = [
                Heard(topic, reader.type_name, time.time_ns(), describe(reader.type_name, cdr))
                for topic, reader in self._readers.items()
                for cdr in reader.take()
            ]
            if taken or time.monotonic() > deadline_s:
                return taken
            time.sleep(0.005)

    def close(self) -> None:
        """See ``Carrier``; DDS leaves the domain when nothing refers to it any more."""
        self._readers.clear()

    def _look_for_topics(self) -> None:
        if time.monotonic() < self._looked_s + self.LOOK_S:
            return
        self._looked_s = time.monotonic()
        from node.bus.messages import typestore

        for name, type_name, qos in self._published():
            if name not in self._readers and type_name in typestore().fielddefs:
                self._readers[name] = self._participant.reader(name, type_name, qos)


def describe(type_name: str, cdr: bytes) -> str:
    """Return one line on a ROS message; how large it is where murk has no words for its type."""
    from dbc.errors import InputError
    from node.bus.messages import deserialize, typestore

    words = _WORDS.get(type_name)
    if words is None:
        return f"{len(cdr):,} bytes"
    try:
        return words(deserialize(type_name, cdr, typestore()))
    except InputError as error:
        return str(error)


def _can_text(level: CanLevel) -> str:
    return (
        f"{level.sensor_type} {level.state}: {level.level:.1f} % ± {level.std:.1f}, {level.kind}"
        f" ({level.age_ms} ms ago)"
    )


def _injected(message: Any) -> str:
    pairs = zip(message.injected_kinds, message.injected_levels, strict=True)
    text = ", ".join(f"{kind} {level:.0f}" for kind, level in pairs)
    return f"; injected {text}" if text else ""


_WORDS: dict[str, Callable[[Any], str]] = {
    "murk_msgs/msg/NoiseLevel": lambda message: (
        f"{message.level:.1f} % ± {message.std_dev:.1f}, {message.kind}{_injected(message)}"
    ),
    "murk_msgs/msg/ModelChoice": lambda message: f"{message.model}: {message.reason}",
    "murk_msgs/msg/NodeState": lambda message: f"{message.node} {message.state}",
    "murk_msgs/msg/NodeEvent": lambda message: f"{message.source}: {message.detail}",
    "murk_msgs/msg/SensorEvent": lambda message: f"{message.state}: {message.detail}",
    "sensor_msgs/msg/PointCloud2": lambda message: f"{message.height * message.width} points",
    "sensor_msgs/msg/CompressedImage": lambda message: (
        f"{message.format}, {len(message.data):,} bytes"
    ),
    "diagnostic_msgs/msg/DiagnosticArray": lambda message: "; ".join(
        f"{status.name}: {status.message}" for status in message.status
    ),
}
