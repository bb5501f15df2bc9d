"""Live cameras through V4L2 and OpenCV, with the driver's own capture stamps."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Lock
from typing import Literal

import cv2
import numpy as np
from cv2.utils import logging as opencv_log
from numpy.typing import NDArray

from dbc.errors import DeviceError
from drivers.camera import FrameSource
from drivers.frame import Frame, StampSource
from drivers.frame_pace import FramePace
from drivers.v4l2_devices import find_camera, list_cameras

FIRST_FRAME_S = 5.0
STALL_S = 1.0
STALL_INTERVALS = 5
"""A camera is stalled after this many of its intervals without a frame, but not before STALL_S."""

WAIT_S = 0.1
"""How long a wait for a frame blocks before it looks whether the camera was closed."""

DEFAULT_INTERVAL_NS = round(1e9 / 30)
"""Where a camera does not tell its rate."""

SAME_CLOCK_S = 10.0
"""A first stamp farther than this from the monotonic clock was not taken by that clock."""


class CameraLost(DeviceError):  # noqa: N818  (an event of a live stream)
    """The camera was unplugged or its driver gave up; ``V4L2Camera.reopen`` may bring it back."""


class CameraStalled(DeviceError):  # noqa: N818  (an event of a live stream)
    """No frame for much longer than the camera's interval; the next read waits for it again."""


class V4L2Camera(FrameSource):
    """A live camera: each ``next`` waits for a frame.

    A stamp is the driver's, taken by the monotonic clock (``stamp_source`` "device") and moved to
    wall time by the difference of the two clocks when the camera was opened, so that a later
    correction of the wall clock tears no hole. Where the driver gives none, it is the time of
    reading ("read").

    Lost frames are estimated from gaps between device stamps (``FramePace``), those of a stall or
    an unplugged while included. Frames read late, because nobody asked, keep their stamps.

    Parameters
    ----------
    spec:
        See ``drivers.v4l2_devices.find_camera``.
    sensor:
        The camera's name in the scene.
    size:
        (width, height); by default 640 × 480 or the nearest that it has.
    rate_hz:
        Frames a second; by default the camera's own.
    pixel_format:
        By default OpenCV's choice.

    Attributes
    ----------
    device:
        What was opened.
    frozen:
        How many of the latest frames in a row have exactly the image of the frame before them;
        0 while the picture lives, since no two images of a real sensor are alike.

    Raises
    ------
    DeviceError
        By the constructor: if the camera is missing, busy, not a camera, or does not give what
        was asked for. By ``next``: ``CameraLost`` or ``CameraStalled``.
    """

    live = True

    def __init__(
        self,
        spec: str | Path,
        sensor: str,
        *,
        size: tuple[int, int] | None = None,
        rate_hz: float | None = None,
        pixel_format: Literal["MJPG", "YUYV"] | None = None,
    ) -> None:
        self.device = find_camera(spec)
        self.sensor = sensor
        self.frozen = 0
        self._size = size
        self._rate_hz = rate_hz
        self._pixel_format = pixel_format
        self._sequence = -1
        self._last_image: NDArray[np.uint8] | None = None
        self._closed = Event()
        self._in_use = Lock()
        self._wall_minus_monotonic_ns = wall_minus_monotonic_ns()
        self._pace = FramePace(DEFAULT_INTERVAL_NS)
        self._open()

    @property
    def nominal_rate_hz(self) -> float:
        """The negotiated rate."""
        return 1e9 / self._pace.nominal_ns

    @property
    def rate_hz(self) -> float:
        """The rate that the camera keeps; below the nominal one where it is slow."""
        return 1e9 / self._pace.interval_ns

    def __next__(self) -> Frame:
        """Wait for the next frame.

        Raises
        ------
        StopIteration
            After ``close``.
        CameraStalled
            If it does not come in time; call again to go on waiting.
        CameraLost
            If the camera is gone; so says every call until ``reopen`` succeeds.
        """
        with self._in_use:
            while True:
                self._wait()
                taken, image = self._capture.read()
                if taken:
                    return self._frame(image.astype(np.uint8, copy=False))
                self.dropped += 1  # a picture that does not decode, such as a torn MJPG
                self._sequence += 1

    def reopen(self) -> None:
        """Open the same camera again, wherever it is plugged in by now.

        Raises
        ------
        DeviceError
            If it is not there, or not ready yet.
        """
        with self._in_use:
            self._release()
            for device in list_cameras():
                if device.is_same_camera(self.device):
                    self.device = device
                    return self._open()
            raise DeviceError(self.device.path, "the camera is gone", "plug the same one in again")

    def close(self) -> None:
        """Release the camera; a waiting reader in another thread gets no further frame."""
        self._closed.set()
        with self._in_use:
            self._release()

    def _open(self) -> None:
        path = self.device.path
        with _silent_opencv():
            self._capture = cv2.VideoCapture(str(path), cv2.CAP_V4L2)
            if not self._capture.isOpened():
                raise DeviceError(path, "is busy, or its format unknown", "is it in use elsewhere?")
            try:
                self._negotiate()
            except DeviceError:
                self._release()
                raise
        self._stamp_source: StampSource | None = None

    def _negotiate(self) -> None:
        """Ask for size, rate and format, and see what the camera gives."""
        capture = self._capture
        if self._pixel_format is not None:
            capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*self._pixel_format))
        if self._size is not None:
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
        if self._rate_hz is not None:
            capture.set(cv2.CAP_PROP_FPS, self._rate_hz)
        width = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH))
        height = int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        rate_hz = capture.get(cv2.CAP_PROP_FPS)
        code = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode(errors="replace")
        if (
            self._size not in (None, (width, height))
            or self._pixel_format not in (None, code)
            or (self._rate_hz is not None and abs(rate_hz / self._rate_hz - 1) > 0.01)
        ):
            raise DeviceError(
                self.device.path,
                f"gives only {width}x{height} {code} at {rate_hz:g} Hz",
                "v4l2-ctl --list-formats-ext shows what it can",
            )
        self._pace.nominal_ns = round(1e9 / rate_hz) if rate_hz > 0 else DEFAULT_INTERVAL_NS

    def _release(self) -> None:
        with _silent_opencv():
            self._capture.release()

    def _wait(self) -> None:
        """Wait until the driver has a frame."""
        give_up = time.monotonic() + self._patience_s()
        while time.monotonic() < give_up:
            if self._closed.is_set():
                raise StopIteration
            if self._frame_is_ready():
                return
        raise CameraStalled(
            self.device.path, f"no frame for {self._patience_s():g} s", "does the camera hang?"
        )

    def _frame_is_ready(self) -> bool:
        lost = CameraLost(self.device.path, f"lost camera {self.device.card}", "is it unplugged?")
        if not self._capture.isOpened():  # waitAny would crash
            raise lost
        try:
            ready, _ = cv2.VideoCapture.waitAny([self._capture], round(WAIT_S * 1e9))
        except cv2.error as error:
            self._release()
            raise lost from error
        return ready

    def _patience_s(self) -> float:
        if self._stamp_source is None:
            return FIRST_FRAME_S
        return max(STALL_S, STALL_INTERVALS * self._pace.interval_ns / 1e9)

    def _frame(self, image: NDArray[np.uint8]) -> Frame:
        stamp_ns, source = self._stamp()
        missing = self._pace.missing_before(stamp_ns) if source == "device" else 0
        self.dropped += missing
        self._sequence += 1 + missing
        self.frozen = self.frozen + 1 if _same_image(image, self._last_image) else 0
        self._last_image = image
        return Frame(image, self.sensor, self._sequence, stamp_ns, source, self.dropped)

    def _stamp(self) -> tuple[int, StampSource]:
        """Return the stamp of the frame just read, in wall time, and who took it."""
        device_ns = round(self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1000) * 1000
        now_ns = time.monotonic_ns()
        if self._stamp_source is None:
            same_clock = abs(now_ns - device_ns) < SAME_CLOCK_S * 1e9
            self._stamp_source = "device" if same_clock else "read"
        stamp_ns = device_ns if self._stamp_source == "device" else now_ns
        return stamp_ns + self._wall_minus_monotonic_ns, self._stamp_source


def wall_minus_monotonic_ns() -> int:
    """Return what to add to the monotonic clock's time to get wall time, nanoseconds.

    Of five readings the one counts in which the two clocks were read closest together.
    """
    readings = []
    for _ in range(5):
        before = time.monotonic_ns()
        wall = time.time_ns()
        after = time.monotonic_ns()
        readings.append((after - before, wall - (before + after) // 2))
    return min(readings)[1]


def _same_image(image: NDArray[np.uint8], last: NDArray[np.uint8] | None) -> bool:
    if last is None or image.shape != last.shape:
        return False
    rows = slice(None, None, 16)  # nearly always these differ already
    return np.array_equal(image[rows], last[rows]) and np.array_equal(image, last)


@contextmanager
def _silent_opencv() -> Iterator[None]:
    """Keep OpenCV from writing to standard error what is told by an exception."""
    level = opencv_log.getLogLevel()
    opencv_log.setLogLevel(opencv_log.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        opencv_log.setLogLevel(level)
