"""The gateway from a camera or a recording to a video file, a pipe or a V4L2 output device."""

from __future__ import annotations

import time
from collections import Counter
from threading import Event, Thread
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MurkError
from drivers.frame import Frame
from drivers.frame_sink import open_frame_sink
from node.camera_faults import CameraFaults
from node.gateway_levels import GatewayLevels
from node.gateway_scene import GatewayScene
from node.gateway_statistics import Latencies
from node.live_sources import Lost
from node.mailbox import Closed, Mailbox
from node.pipeline import WORLD_DURATION_S
from node.scene import WORLD
from node.sources import Source, open_source

QUEUE_DEPTH = 16
"""Frames that wait to be sent at most: as many as come while one is late, and some more."""


class _Outgoing(NamedTuple):
    image: NDArray[np.uint8]
    arrival_ns: int
    due_ns: int
    stamp_ns: int


class VideoLink:
    """Degrades the frames of one camera and sends them on, in order, each as late as it came.

    A recording is played at its own pace where whoever gets the frames sees them at once, and as
    fast as possible into a file.

    Parameters
    ----------
    scene:
        The camera, and what is done to it.
    levels:
        What is in force when.
    target:
        See ``drivers.frame_sink.open_frame_sink``.
    stop:
        Ends the run.

    Raises
    ------
    VideoError, DeviceError
        If input or output cannot be opened.
    """

    def __init__(
        self, scene: GatewayScene, levels: GatewayLevels, target: str, stop: Event
    ) -> None:
        self._levels = levels
        self._duration_s = scene.duration_s
        self._faults = CameraFaults(scene.sensor.name, scene.seed)
        self._counts: Counter[str] = Counter()
        self._latencies = Latencies()
        self._error: MurkError | None = None
        self._stop = stop
        self._source = _open_camera(scene)
        try:
            self._sink = open_frame_sink(target, stop)
        except BaseException:
            self._source.close()
            raise
        lossless = not self._source.live
        self._queue: Mailbox[_Outgoing] = Mailbox(QUEUE_DEPTH, lossless=lossless)

    def run(self) -> None:
        """Pass frames on until the input ends or the run is stopped; then close both sides.

        Raises
        ------
        MurkError
            If reading or sending failed.
        """
        sender = Thread(target=self._send_all, name="murk-send-frames", daemon=True)
        sender.start()
        try:
            self._read_all()
        finally:
            self._queue.close()
            sender.join()
            self.close()
        if self._error is not None:
            raise self._error

    def interrupt(self) -> None:
        """Wake a reader that waits for a live camera."""
        if self._source.live:
            self._source.close()

    def close(self) -> None:
        """Close both sides."""
        self._source.close()
        self._sink.close()

    def summary(self) -> dict[str, Any]:
        """Return what was counted, for JSON."""
        names = ("frames_in", "frames_out", "degraded", "camera_lost", "dropped")
        record: dict[str, Any] = {name: self._counts[name] for name in names}
        record["dropped_by_queue"] = self._queue.dropped
        record["faults"] = dict(self._faults.counts)
        return record | self._latencies.summary()

    def _read_all(self) -> None:
        """Read, degrade and queue frames until the input ends or the run is stopped."""
        first_stamp_ns = started_ns = last_due_ns = last_stamp_ns = 0
        for message in self._source.messages():
            frame = message.frame if isinstance(message, Lost) else message
            if not isinstance(frame, Frame):
                self._counts["camera_lost"] += isinstance(message, Lost)
                continue
            arrival_ns = time.monotonic_ns()
            if not self._counts["frames_in"]:
                first_stamp_ns, started_ns = frame.stamp_ns, arrival_ns
            passed_ns = frame.stamp_ns - first_stamp_ns
            over = self._duration_s is not None and passed_ns * 1e-9 >= self._duration_s
            if over or self._stop.is_set():
                return
            self._counts["frames_in"] += 1
            self._counts["dropped"] = frame.dropped
            changed, late_ns = self._changed(frame, passed_ns * 1e-9)
            if changed is None:
                continue
            came_ns = arrival_ns if self._source.live else started_ns + passed_ns
            last_due_ns = max(came_ns + late_ns, last_due_ns)
            last_stamp_ns = max(frame.stamp_ns + late_ns, last_stamp_ns)
            self._queue.put(_Outgoing(changed.image, came_ns, last_due_ns, last_stamp_ns))

    def _changed(self, frame: Frame, t_s: float) -> tuple[Frame | None, int]:
        """Return what becomes of a frame, None where it is lost, and how late it comes, ns."""
        degraded, injected = self._levels.injector.inject(frame, t_s)
        self._counts["degraded"] += bool(injected)
        return self._faults.apply(degraded, self._levels.rates_at(t_s))

    def _send_all(self) -> None:
        """Send what is queued, each frame when it is due, until the queue is closed."""
        try:
            while True:
                outgoing = self._queue.get()
                if self._is_due(outgoing):
                    self._sink.write(outgoing.image, outgoing.stamp_ns)
                    self._counts["frames_out"] += 1
                    self._latencies.add([time.monotonic_ns() - outgoing.arrival_ns])
        except Closed:
            return
        except MurkError as error:
            self._error = error
        finally:
            self._stop.set()
            self._queue.close()

    def _is_due(self, outgoing: _Outgoing) -> bool:
        """Wait until a frame is to be seen; False where the run was stopped before that."""
        if not self._sink.live:
            return True
        wait_s = (outgoing.due_ns - time.monotonic_ns()) * 1e-9
        return not (self._stop.wait(wait_s) if wait_s > 0 else self._stop.is_set())


def _open_camera(scene: GatewayScene) -> Source:
    if scene.sensor.source != WORLD:
        return open_source(scene.sensor, None)
    from models.world.road import World

    duration_s = scene.duration_s or WORLD_DURATION_S
    return open_source(scene.sensor, World(seed=scene.seed, duration_s=duration_s))
