"""One topic of ROS 2: nothing is serialised that nobody reads."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import Any

from node.bus.dds import LATCHED, RosParticipant
from node.bus.messages import RosMessage

log = logging.getLogger("murk.ros2")


class Publication:
    """Sends messages to the readers that there are; without any, a message is not serialised.

    A latched topic keeps the last message for whoever comes first. When its last reader has left,
    DDS is made to forget what it holds, so that a late joiner never gets an old value.

    Parameters
    ----------
    topic, type_name:
        Their names in ROS.
    qos:
        Of ``node.bus.dds``; the topic is latched where it is ``LATCHED``.
    serialize:
        Makes the ROS message.

    Attributes
    ----------
    topic:
        Its name in ROS.
    sent, dropped, failed:
        Messages that were written, that a reader kept waiting for too long, and that could not be
        serialised.
    """

    def __init__(
        self,
        participant: RosParticipant,
        topic: str,
        type_name: str,
        qos: Any,
        serialize: Callable[[Any], RosMessage],
    ) -> None:
        self.sent = self.dropped = self.failed = 0
        self.topic = topic
        self._open = partial(participant.writer, topic, type_name, qos)
        self._serialize = serialize
        self._latched = qos is LATCHED
        self._writer = self._open()
        self._written = False
        self._last: Any = None
        self._waits = False

    def send(self, message: Any) -> None:
        """Send a message, or have it wait for the first reader where the topic is latched."""
        self._last, self._waits = message, True
        self.flush()

    def flush(self) -> None:
        """Send what waits if a reader has come."""
        if self._writer.matched():
            if self._waits:
                self._write()
        elif not self._latched:
            self._last, self._waits = None, False
        elif self._written:
            self._writer = self._open()
            self._written, self._waits = False, True

    def readers(self) -> int:
        """Return how many readers there are now."""
        return self._writer.matched()

    def close(self) -> None:
        """Withdraw the topic."""
        self._writer.close()

    def _write(self) -> None:
        self._waits = False
        try:
            in_time = self._writer.write(self._serialize(self._last).cdr)
        except Exception:
            self.failed += 1
            if self.failed == 1:
                log.exception("a message on %s failed; further failures are counted", self.topic)
        else:
            self.sent += in_time
            self.dropped += not in_time
            self._written = True
