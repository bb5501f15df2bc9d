"""The in-process bus: topics, their latest value, and callbacks that cannot stall the pipeline."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from threading import Lock, Thread
from types import TracebackType
from typing import Any, Protocol, Self

from node.mailbox import Closed, Mailbox

log = logging.getLogger("murk.bus")

KEEP_LAST = 5
"""Messages kept for a subscriber that is behind, as ROS 2's sensor-data QoS does."""


class Listener(Protocol):
    """Whatever takes the messages of a topic, each in the thread that publishes it."""

    def deliver(self, message: Any) -> None:
        """Take a message."""

    def close(self) -> None:
        """Take no more, and leave the bus."""


class Subscription:
    """One listener of one topic; it has a queue of its own, so that it can only delay itself.

    Iterate over it, or give ``Bus.subscribe`` a callback.
    """

    def __init__(self, bus: Bus, topic: str, depth: int) -> None:
        self.topic = topic
        self.errors = 0
        self._bus = bus
        self._mailbox: Mailbox[Any] = Mailbox(depth, lossless=False)
        self._caller: Thread | None = None

    @property
    def dropped(self) -> int:
        """Messages this listener was too slow for."""
        return self._mailbox.dropped

    def deliver(self, message: Any) -> None:
        """Queue a message; called by the bus."""
        self._mailbox.put(message)

    def __iter__(self) -> Iterator[Any]:
        while True:
            try:
                yield self._mailbox.get()
            except Closed:
                return

    def close(self) -> None:
        """Stop listening; what is queued is still delivered."""
        self._bus.detach(self.topic, self)
        self._mailbox.close()

    def start(self, callback: Callable[[Any], None]) -> None:
        """Have a thread call ``callback`` with every message until closed."""
        name = f"murk-callback-{self.topic}"
        self._caller = Thread(target=self.call, args=(callback,), name=name, daemon=True)
        self._caller.start()

    def join(self, timeout_s: float) -> None:
        """Wait, after ``close``, until the callback has had what was queued."""
        if self._caller is not None:
            self._caller.join(timeout_s)

    def call(self, callback: Callable[[Any], None]) -> None:
        """Call ``callback`` with every message until closed; what it raises is counted."""
        for message in self:
            try:
                callback(message)
            except Exception:
                self.errors += 1
                if self.errors == 1:
                    log.exception(
                        "a callback on %s failed; further failures are counted", self.topic
                    )


class Bus:
    """Topics by name; publishing costs one queue operation a subscriber.

    It never waits, but for a recorder that shall lose nothing of a run as fast as possible.
    Use as a context manager, or call ``close``.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._listeners: dict[str, list[Listener]] = {}
        self._latest: dict[str, Any] = {}

    def publish(self, topic: str, message: Any) -> None:
        """Make ``message`` the topic's latest value and deliver it to every listener."""
        with self._lock:
            self._latest[topic] = message
            listeners = tuple(self._listeners.get(topic, ()))
        for listener in listeners:
            listener.deliver(message)

    def latest(self, topic: str) -> Any | None:
        """Return the last message published on the topic, or None."""
        return self._latest.get(topic)

    def topics(self) -> list[str]:
        """Return the topics on which something was published, sorted."""
        with self._lock:
            return sorted(self._latest)

    def has_subscribers(self, topic: str) -> bool:
        """Tell whether anybody listens, so that nothing is made for nobody."""
        return bool(self._listeners.get(topic))

    def subscribe(
        self,
        topic: str,
        callback: Callable[[Any], None] | None = None,
        *,
        depth: int = KEEP_LAST,
        last_value: bool = True,
    ) -> Subscription:
        """Listen to a topic: iterate over the result, or have ``callback`` called in its thread.

        Parameters
        ----------
        depth:
            Messages kept while the listener is busy; the oldest is dropped, and counted.
        last_value:
            Deliver the topic's latest value at once (a late joiner's first message).
        """
        subscription = Subscription(self, topic, depth)
        self.attach(topic, subscription, last_value=last_value)
        if callback is not None:
            subscription.start(callback)
        return subscription

    def attach(self, topic: str, listener: Listener, *, last_value: bool = True) -> None:
        """Deliver the topic's messages to ``listener``; ``last_value`` as for ``subscribe``."""
        with self._lock:
            self._listeners.setdefault(topic, []).append(listener)
            if last_value and topic in self._latest:
                listener.deliver(self._latest[topic])

    def detach(self, topic: str, listener: Listener) -> None:
        """Stop delivering to a listener."""
        with self._lock:
            listeners = self._listeners.get(topic, [])
            if listener in listeners:
                listeners.remove(listener)

    def close(self) -> None:
        """Close every listener."""
        with self._lock:
            open_ones = [one for listeners in self._listeners.values() for one in listeners]
        for listener in open_ones:
            listener.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
