"""A thread that sends topics of the bus on to ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from threading import Thread
from time import monotonic
from typing import Any

from node.bus.in_process import KEEP_LAST, Bus
from node.bus.inbox import Inbox, Published
from node.bus.ros2_publication import Publication

CYCLE_S = 0.05
"""How long a reader that has come waits for the last value, and a request to be heard, at most."""
JOIN_S = 2.0


class Carrier:
    """Sends what the bus publishes to ROS 2 until closed.

    Parameters
    ----------
    publications:
        By topic of the bus.
    every_cycle:
        Called in the same thread every ``CYCLE_S`` with the messages that were sent meanwhile.

    Attributes
    ----------
    publications:
        All of them.
    """

    def __init__(
        self,
        bus: Bus,
        publications: Mapping[str, Sequence[Publication]],
        every_cycle: Callable[[list[Any]], None] | None = None,
    ) -> None:
        self.publications = [one for several in publications.values() for one in several]
        self._by_source = publications
        self._every_cycle = every_cycle
        self._sent: list[Any] = []
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
        due_s = monotonic()
        while not self._inbox.closed:
            self._send(self._inbox.take(max(0.0, due_s - monotonic())))
            if monotonic() >= due_s:
                due_s = monotonic() + CYCLE_S
                self._cycle()
        self._send(self._inbox.take(0))
        self._cycle()

    def _send(self, taken: Sequence[Published]) -> None:
        for published in taken:
            for one in self._by_source[published.topic]:
                one.send(published.message)
            self._sent.append(published.message)

    def _cycle(self) -> None:
        for one in self.publications:
            one.flush()
        sent, self._sent = self._sent, []
        if self._every_cycle is not None:
            self._every_cycle(sent)
