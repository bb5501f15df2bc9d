"""One bounded queue for many topics, emptied in order of arrival by one thread."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from threading import Condition
from time import time_ns
from typing import Any, NamedTuple

from node.bus.in_process import Bus


class Published(NamedTuple):
    """A message, how many came before it, and when: wall time, nanoseconds."""

    number: int
    time_ns: int
    topic: str
    message: Any


class Inbox:
    """Takes the messages of several topics, so many of each at most.

    Parameters
    ----------
    depths:
        By topic, messages that wait at most.
    lossless:
        True: a publisher waits for room. False: the topic's oldest message makes room and is
        counted.
    """

    def __init__(self, bus: Bus, depths: Mapping[str, int], *, lossless: bool) -> None:
        self.dropped = 0
        self._lossless = lossless
        self._changed = Condition()
        self._closed = False
        self._count = 0
        self._taps = [_Tap(bus, self, topic, depth) for topic, depth in depths.items()]
        for tap in self._taps:
            bus.attach(tap.topic, tap)

    def put(self, tap: _Tap, message: Any) -> None:
        """Queue a message; after ``close`` it is discarded."""
        with self._changed:
            if self._lossless:
                self._changed.wait_for(lambda: len(tap.waiting) < tap.depth or self._closed)
            elif len(tap.waiting) >= tap.depth:
                tap.waiting.popleft()
                self.dropped += 1
            if not self._closed:
                tap.waiting.append(Published(self._count, time_ns(), tap.topic, message))
                self._count += 1
                self._changed.notify_all()

    def take(self, timeout_s: float) -> list[Published]:
        """Take all that wait, in order of arrival; wait for one, but no longer than that."""
        with self._changed:
            self._changed.wait_for(self._is_ready, timeout_s)
            taken = [one for tap in self._taps for one in tap.waiting]
            for tap in self._taps:
                tap.waiting.clear()
            self._changed.notify_all()
        return sorted(taken, key=lambda one: one.number)

    def _is_ready(self) -> bool:
        return self._closed or any(tap.waiting for tap in self._taps)

    @property
    def closed(self) -> bool:
        """Whether no more comes; what waits can still be taken."""
        return self._closed

    def close(self) -> None:
        """Take no more from the bus; publishers that wait go on."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        for tap in self._taps:
            tap.close()


class _Tap:
    """What an inbox attaches to a topic."""

    def __init__(self, bus: Bus, inbox: Inbox, topic: str, depth: int) -> None:
        self.topic = topic
        self.depth = depth
        self.waiting: deque[Published] = deque()
        self._bus = bus
        self._inbox = inbox

    def deliver(self, message: Any) -> None:
        self._inbox.put(self, message)

    def close(self) -> None:
        self._bus.detach(self.topic, self)
