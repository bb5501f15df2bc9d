"""A thread that sends topics of the bus on to ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from threading import Thread
from typing import Any

from node.bus.in_process import KEEP_LAST, Bus
from node.bus.inbox import Inbox
from node.bus.ros2_publication import Publication

CYCLE_S = 0.05
"""How long a reader that has come waits for the last value at most."""
JOIN_S = 2.0


class Carrier:
    """Sends what the bus publishes to ROS 2 until closed.

    Parameters
    ----------
    publications:
        By topic of the bus.
    beside:
        Called in the same thread at least every ``CYCLE_S`` with the messages that were just sent.

    Attributes
    ----------
    publications:
        All of them.
    """

    def __init__(
        self,
        bus: Bus,
        publications: Mapping[str, Sequence[Publication]],
        beside: Callable[[list[Any]], None] | None = None,
    ) -> None:
        self.publications = [one for several in publications.values() for one in several]
        self._by_source = publications
        self._beside = beside
        self._inbox = Inbox(bus, dict.fromkeys(publications, KEEP_LAST), lossless=False)
        self._thread = Thread(target=self._run, name="murk-ros2", daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Messages that came faster than they were sent."""
        return self._inbox.dropped

    def close(self) -> None:
        """Send what is queued, and withdraw the topics."""
        self._inbox.close()
        self._thread.join(JOIN_S)
        for one in self.publications:
            one.close()

    def _run(self) -> None:
        while not self._inbox.closed:
            self._send(self._inbox.take(CYCLE_S))
        self._send(self._inbox.take(0))

    def _send(self, taken: Sequence[Any]) -> None:
        for published in taken:
            for one in self._by_source[published.topic]:
                one.send(published.message)
        for one in self.publications:
            one.flush()
        if self._beside is not None:
            self._beside([published.message for published in taken])
