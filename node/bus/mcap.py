"""The bus into an MCAP recording: levels, events, choices, and the sensors' data as asked for."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from threading import Thread
from time import monotonic, sleep, time_ns
from typing import Any

from node.bus.in_process import Bus
from node.bus.inbox import Inbox, Published
from node.bus.mcap_writer import McapWriter
from node.events import EVENT_TOPIC, MODEL_TOPIC, STATE_TOPIC, NodeEvent
from node.plan import Plan
from node.scene import Scene

log = logging.getLogger("murk.record")

FLUSH_S = 0.4
"""How often a chunk is ended and brought onto the disk; a message waits for it twice at most."""
GATHER_S = 0.05
"""Pause before the queue is emptied: messages gather, and cost half as much together."""
DEPTH = 256
IMAGE_DEPTH = 8
"""Messages of a topic that wait for the disk at most; images are large."""
JOIN_S = 30.0


class McapRecorder:
    """Records what a scene asks for; see ``docs/recording.md``.

    A thread of its own writes, from a queue that drops the oldest of a topic and counts it; as
    fast as possible the pipeline waits for it instead, and nothing is dropped. When the disk does
    not take more, recording ends with a ``NodeEvent``, and the node goes on.

    Raises
    ------
    InputError
        If the file exists or cannot be written.
    """

    def __init__(self, plan: Plan, bus: Bus) -> None:
        scene = plan.scene
        self._bus = bus
        self._writer = McapWriter(scene)
        self._path = scene.outputs.record.path if scene.outputs.record else None
        self._failed = 0
        self._stopped: str | None = None
        self._gather_s = 0.0 if scene.clock.fast else GATHER_S
        self._inbox = Inbox(bus, dict(_depths(scene)), lossless=scene.clock.fast)
        self._thread = Thread(target=self._record, name="murk-record", daemon=True)
        self._thread.start()

    def counts(self) -> dict[str, Any]:
        """Return ``path``, files and ``messages`` written, those ``dropped`` and ``failed``.

        ``stopped`` says why, where recording ended before the run.
        """
        counts = {
            "path": str(self._path),
            "files": self._writer.parts,
            "messages": self._writer.messages,
            "dropped": self._inbox.dropped,
            "failed": self._failed,
        }
        return counts if self._stopped is None else {**counts, "stopped": self._stopped}

    def close(self) -> None:
        """Write what is queued, and end the file."""
        self._inbox.close()
        self._thread.join(JOIN_S)
        if self._thread.is_alive():
            self._stopped = f"recording to {self._path} hangs; it is left as it is"
            log.error("%s", self._stopped)

    def _record(self) -> None:
        try:
            self._write_until_closed()
            self._writer.close()
        except OSError as error:
            # Nobody may wait for room in the queue any more, this thread's own event included.
            self._inbox.close()
            self._writer.abandon()
            self._stopped = f"recording to {self._path} stopped: {error.strerror}"
            log.error("%s", self._stopped)
            self._bus.publish(EVENT_TOPIC, NodeEvent("record", time_ns(), self._stopped))

    def _write_until_closed(self) -> None:
        flushed_s, last = monotonic(), False
        while not last:
            last = self._inbox.closed
            if not last:
                sleep(self._gather_s)
            for published in self._inbox.take(FLUSH_S):
                self._write(published)
                if monotonic() - flushed_s >= FLUSH_S:
                    self._writer.flush()
                    flushed_s = monotonic()
            if monotonic() - flushed_s >= FLUSH_S:
                self._writer.flush()
                flushed_s = monotonic()

    def _write(self, published: Published) -> None:
        try:
            self._writer.write(published)
        except OSError:
            raise
        except Exception:
            self._failed += 1
            if self._failed == 1:
                log.exception("a message of %s is not recorded; more are counted", published.topic)


def _depths(scene: Scene) -> Iterator[tuple[str, int]]:
    """Yield the topics to record, and how many messages of each may wait."""
    settings = scene.outputs.record
    assert settings is not None, "plan() keeps this output where the scene asks for it"
    for topic in (STATE_TOPIC, EVENT_TOPIC, MODEL_TOPIC):
        yield topic, DEPTH
    for sensor in scene.sensors:
        yield f"/murk/{sensor.name}/noise_level", DEPTH
        yield f"/murk/{sensor.name}/event", DEPTH
        if sensor.type == "radar" and settings.scans:
            yield f"/murk/{sensor.name}/scan", DEPTH
        if sensor.type == "camera" and settings.images:
            yield f"/murk/{sensor.name}/image", IMAGE_DEPTH
