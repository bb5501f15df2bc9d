"""The video of a drive in step with the CAN logs that are played."""

from __future__ import annotations

import time
from pathlib import Path
from queue import SimpleQueue
from threading import Event, Thread

from dbc.errors import MurkError
from drivers.camera import open_camera_source
from drivers.frame_sink import FrameSink, open_frame_sink

_END = -1
LATE_FRAME_NS = 50_000_000
"""A frame that is later than this is skipped, so that the video catches up."""


class VideoPlayer:
    """Plays a video into a sink, each lap from when ``begin`` says.

    Parameters
    ----------
    video:
        A video file or a folder of images; its first frame belongs to the logs' first frame.
    sink:
        A V4L2 output device, a file or a pipe; see ``drivers.frame_sink.open_frame_sink``.
    start_s:
        Where a lap begins, seconds since the first frame.
    speed:
        Factor on time.

    Attributes
    ----------
    shown, skipped:
        Frames sent, and frames that were too late.
    error:
        Why it ended early, if it did.

    Raises
    ------
    VideoError, DeviceError
        If video or sink cannot be opened.
    """

    def __init__(self, video: Path, sink: str, *, start_s: float = 0.0, speed: float = 1.0) -> None:
        self.shown = self.skipped = 0
        self.error: MurkError | None = None
        self._video = video
        self._start_ns = round(start_s * 1e9)
        self._speed = speed
        self._stop = Event()
        self._laps: SimpleQueue[int] = SimpleQueue()
        open_camera_source(video, "video").close()  # what is no video is told before anything plays
        self._sink: FrameSink = open_frame_sink(sink, self._stop)
        self._thread = Thread(target=self._run, name="murk-play-video", daemon=True)
        self._thread.start()

    def begin(self, start_ns: int) -> None:
        """Begin a lap at a time of the monotonic clock, nanoseconds; the lap before ends."""
        self._laps.put(start_ns)

    def close(self) -> None:
        """Stop and finish the sink."""
        self._stop.set()
        self._laps.put(_END)
        self._thread.join()
        self._sink.close()

    def _run(self) -> None:
        try:
            while (start_ns := self._laps.get()) != _END and not self._stop.is_set():
                self._play(start_ns)
        except MurkError as error:
            self.error = error

    def _play(self, start_ns: int) -> None:
        first_ns: int | None = None
        with open_camera_source(self._video, "video") as frames:
            for frame in frames:
                first_ns = frame.stamp_ns if first_ns is None else first_ns
                t_ns = frame.stamp_ns - first_ns - self._start_ns
                if t_ns < 0:
                    continue
                due_ns = start_ns + round(t_ns / self._speed)
                if not self._wait_until(due_ns):
                    return
                if time.monotonic_ns() - due_ns > LATE_FRAME_NS:
                    self.skipped += 1
                    continue
                self._sink.write(frame.image, frame.stamp_ns)
                self.shown += 1

    def _wait_until(self, due_ns: int) -> bool:
        """Wait; return False where the lap is over before."""
        wait_s = (due_ns - time.monotonic_ns()) / 1e9
        if wait_s > 0:
            self._stop.wait(wait_s)
        return not self._stop.is_set() and self._laps.empty()
