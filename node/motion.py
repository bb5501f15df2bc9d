"""Tells a radar how the vehicle moves: 0x300 and 0x301 at their rate, from a bus or a log."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from threading import Event, Thread
from time import monotonic
from typing import Protocol

from dbc.errors import MurkError
from drivers.can_frames import CanFrames
from drivers.encode import encode_motion
from drivers.scan import MotionInput
from node.pace import Pace

log = logging.getLogger("murk.motion")

PERIOD_S = 0.05
"""The radar expects its motion input 20 times a second, as the recordings show it."""
STALE_S = 1.0
"""A motion older than this is not sent: the radar shall report that it is missing."""


class _Messages(Protocol):
    live: bool

    def messages(self) -> Iterator[object]: ...

    def close(self) -> None: ...


class MotionSender:
    """Sends the newest motion of a source to a radar until ``close``.

    Parameters
    ----------
    source:
        Whose ``MotionInput`` messages are sent on; a log is read in its own time.
    send:
        Sends frames on the radar's bus.
    sensor_id:
        The radar's, which shifts the CAN IDs.

    Attributes
    ----------
    failures:
        Times that the bus did not take the frames.
    """

    def __init__(
        self, source: _Messages, send: Callable[[CanFrames], None], sensor_id: int
    ) -> None:
        self.failures = 0
        self._source = source
        self._send = send
        self._sensor_id = sensor_id
        self._stop = Event()
        self._newest: tuple[float, MotionInput] | None = None
        self._threads = [
            Thread(target=work, name=f"murk-motion-{work.__name__}", daemon=True)
            for work in (self._read, self._repeat)
        ]

    def start(self) -> None:
        """Begin to send."""
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stop; nothing is sent after that."""
        self._stop.set()
        self._source.close()
        for thread in self._threads:
            if thread.is_alive():
                thread.join()

    def _read(self) -> None:
        pace = Pace(None if self._source.live else 1.0)
        try:
            for message in self._source.messages():
                if self._stop.is_set():
                    return
                if not isinstance(message, MotionInput):
                    continue
                if pace.stopped_before(pace.since_start_ns(message.stamp_ns), self._stop):
                    return
                self._newest = (monotonic(), message)
        except MurkError as error:
            log.warning("motion input ended: %s", error)

    def _repeat(self) -> None:
        due_s = monotonic()
        while not self._stop.wait(max(0.0, due_s - monotonic())):
            due_s = max(due_s, monotonic() - PERIOD_S) + PERIOD_S
            newest = self._newest
            if newest is None or monotonic() - newest[0] > STALE_S:
                continue
            try:
                self._send(self._frames(newest[1]))
            except MurkError as error:
                self.failures += 1
                if self.failures == 1:
                    log.warning("motion input: %s; more failures are counted", error)

    def _frames(self, motion: MotionInput) -> CanFrames:
        return encode_motion(motion.speed or 0.0, motion.yaw_rate or 0.0, sensor_id=self._sensor_id)
