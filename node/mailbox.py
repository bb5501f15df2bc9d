"""The queue between two threads of the pipeline: newest wins, or nothing is lost."""

from __future__ import annotations

from collections import deque
from threading import Condition
from typing import Generic, TypeVar

T = TypeVar("T")


class Closed(Exception):  # noqa: N818  (it ends a loop, as StopIteration does)
    """The mailbox is closed and empty."""


class Mailbox(Generic[T]):
    """A bounded queue with a choice of what happens when it is full.

    Parameters
    ----------
    depth:
        Messages held at most.
    lossless:
        True: ``put`` waits for room (recordings, as fast as possible). False: the oldest message
        makes room and is counted (live: an old message is worth less than a new one).
    """

    def __init__(self, depth: int, *, lossless: bool) -> None:
        self._items: deque[T] = deque()
        self._depth = depth
        self._lossless = lossless
        self._changed = Condition()
        self._closed = False
        self._dropped = 0

    @property
    def dropped(self) -> int:
        """Messages dropped since the start."""
        return self._dropped

    def put(self, item: T) -> None:
        """Add a message; after ``close`` it is discarded silently, for nobody reads any more."""
        with self._changed:
            if self._lossless:
                self._changed.wait_for(lambda: len(self._items) < self._depth or self._closed)
            elif len(self._items) >= self._depth:
                self._items.popleft()
                self._dropped += 1
            if not self._closed:
                self._items.append(item)
            self._changed.notify_all()

    def get(self, timeout_s: float | None = None) -> T:
        """Take the oldest message, waiting for one.

        Raises
        ------
        Closed
            If the mailbox is closed and empty.
        TimeoutError
            If nothing came within ``timeout_s``.
        """
        with self._changed:
            if not self._changed.wait_for(lambda: self._items or self._closed, timeout_s):
                raise TimeoutError
            if not self._items:
                raise Closed
            item = self._items.popleft()
            self._changed.notify_all()
            return item

    def close(self) -> None:
        """Accept no more; what is inside can still be taken."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
