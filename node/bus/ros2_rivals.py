"""Other nodes that publish what is this node's to publish."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication

from node.bus.dds import RosParticipant


class Rivals:
    """Notices a second node of the same name, or one with a sensor of the same name.

    Two nodes on one topic give its readers two truths in turn. Neither can know which of them is
    wanted, so both go on and both say it.

    Parameters
    ----------
    topics:
        Names in ROS of the topics that only this node may publish.
    say:
        Called with a line for a person when a rival comes.

    Attributes
    ----------
    seen:
        Rivals since the start.
    """

    def __init__(
        self, participant: RosParticipant, topics: Collection[str], say: Callable[[str], None]
    ) -> None:
        self.seen = 0
        self._own = participant.dds.get_guid()
        self._topics = {f"rt{topic}": topic for topic in topics}
        self._say = say
        self._known: set[Any] = set()
        self._present: dict[Any, str] = {}
        self._reader: Any = BuiltinDataReader(participant.dds, BuiltinTopicDcpsPublication)

    @property
    def topics(self) -> list[str]:
        """Topics that somebody else publishes right now, sorted."""
        return sorted(set(self._present.values()))

    def poll(self) -> None:
        """Take in who has come and gone."""
        while endpoints := self._reader.take(64):
            for endpoint in endpoints:
                if not endpoint.sample_info.valid_data:
                    self._present.pop(endpoint.key, None)
                elif endpoint.topic_name in self._topics and endpoint.participant_key != self._own:
                    topic = self._topics[endpoint.topic_name]
                    self._present[endpoint.key] = topic
                    self._meet(endpoint.participant_key, topic)

    def close(self) -> None:
        """Look no longer."""
        self._reader = None

    def _meet(self, participant: Any, topic: str) -> None:
        if participant not in self._known:
            self._known.add(participant)
            self.seen += 1
            self._say(f"another node publishes {topic}: give one of them another name or namespace")
