"""Where camera frames are sent: a video file, a pipe, or a V4L2 output device."""

from __future__ import annotations

import errno
import os
import select
import stat
import sys
import time
from abc import ABC, abstractmethod
from pathlib import Path
from threading import Event
from types import TracebackType
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MurkError, VideoError

PIPE_PREFIX = "pipe:"
VIDEO_FILES = (".mp4", ".mkv")
LAST_FRAME_S = 1.0
"""How long the frame in hand may still take once the sink is to stop."""
WAIT_S = 0.05
"""How long a wait for the other side lasts before it looks whether the sink is to stop."""


class SinkGone(MurkError):  # noqa: N818  (nobody's mistake)
    """Whoever read the frames has gone, or does not take the last one."""


class FrameSink(ABC):
    """Takes frames of one size; a context manager.

    Attributes
    ----------
    live:
        True where a frame is seen when it is written, False where its stamp says when.
    """

    live: ClassVar[bool]

    @abstractmethod
    def write(self, image: NDArray[np.uint8], stamp_ns: int) -> None:
        """Send a frame, waiting while the other side is busy.

        Parameters
        ----------
        image:
            (height, width, 3) uint8, BGR; the first frame sets the size.
        stamp_ns:
            Nanoseconds; not before that of the frame before.

        Raises
        ------
        VideoError, DeviceError
            If the size changes or the frame cannot be taken.
        SinkGone
            If nobody reads any more.
        """

    @abstractmethod
    def close(self) -> None:
        """Finish; a second time does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def open_frame_sink(spec: str, stop: Event) -> FrameSink:
    """Open what ``spec`` names, importing only the library that it needs.

    Parameters
    ----------
    spec:
        A video file (``x.mp4``, ``x.mkv``), ``-`` for standard output or ``pipe:PATH`` for a named
        pipe, both with raw BGR frames one after the other, or a V4L2 output device
        (``/dev/video2``).
    stop:
        Once it is set, a writer that waits for the other side gives up.

    Raises
    ------
    VideoError
        If it names none of these, or the file or pipe cannot be made.
    DeviceError
        If the device is missing, busy or takes no video.
    """
    if spec == "-":
        return PipeSink.standard_output(stop)
    if spec.startswith(PIPE_PREFIX):
        return PipeSink.named(Path(spec.removeprefix(PIPE_PREFIX)), stop)
    if spec.startswith("/dev/"):
        from drivers.v4l2_output import V4L2Output

        return V4L2Output(Path(spec), stop)
    if Path(spec).suffix.lower() in VIDEO_FILES:
        return FileSink(Path(spec))
    raise VideoError(
        spec, "is no output for frames", "give x.mp4, x.mkv, -, pipe:PATH or /dev/videoN"
    )


class FileSink(FrameSink):
    """A video file that begins with the first frame."""

    live = False

    def __init__(self, path: Path) -> None:
        from drivers.video_writer import TICK_NS, VideoWriter

        self._writer = VideoWriter(path)
        self._tick_ns = TICK_NS[path.suffix.lower()]
        self._first_ns: int | None = None
        self._last_ns = -1

    def write(self, image: NDArray[np.uint8], stamp_ns: int) -> None:
        """Append a frame; see ``FrameSink``."""
        if self._first_ns is None:
            self._first_ns = stamp_ns
        shown_ns = max(stamp_ns - self._first_ns, self._last_ns + self._tick_ns)
        self._writer.write(image, shown_ns)
        self._last_ns = shown_ns

    def close(self) -> None:
        """Finish the file; without a frame there is none."""
        if self._first_ns is None:
            self._writer.discard()
        else:
            self._writer.close()


class PipeSink(FrameSink):
    """Raw BGR frames, row by row from the top, one after the other, without headers.

    Use ``standard_output`` or ``named``.
    """

    live = True

    def __init__(self, name: str, descriptor: int | None, path: Path | None, stop: Event) -> None:
        self._name = name
        self._descriptor = descriptor
        self._path = path
        self._stop = stop
        self._shape: tuple[int, ...] | None = None

    @classmethod
    def standard_output(cls, stop: Event) -> PipeSink:
        """Write to standard output, which must not be a terminal."""
        descriptor = sys.stdout.fileno()
        if os.isatty(descriptor):
            raise VideoError("-", "is a terminal", "redirect it: murk gateway ... - | ffplay ...")
        os.set_blocking(descriptor, False)
        return cls("standard output", descriptor, None, stop)

    @classmethod
    def named(cls, path: Path, stop: Event) -> PipeSink:
        """Write to a named pipe, made where it is missing, once somebody reads from it."""
        try:
            if not path.exists():
                os.mkfifo(path, 0o600)
            if not stat.S_ISFIFO(path.stat().st_mode):
                raise VideoError(path, "is there and no pipe", "give another path")
        except OSError as error:
            raise VideoError(path, f"cannot be made ({error.strerror})") from None
        return cls(str(path), None, path, stop)

    def write(self, image: NDArray[np.uint8], stamp_ns: int) -> None:
        """Write a frame; see ``FrameSink``."""
        if self._shape not in (None, image.shape):
            raise VideoError(self._name, "the frames' size changes", "raw frames cannot say that")
        self._shape = image.shape
        if self._descriptor is None and self._path is not None:
            self._descriptor = self._open(self._path)
        if self._descriptor is None:
            return
        try:
            write_all(self._descriptor, np.ascontiguousarray(image).data.cast("B"), self._stop)
        except BrokenPipeError:
            raise SinkGone(f"{self._name}: the reader has gone") from None
        except TimeoutError:
            raise SinkGone(f"{self._name}: the reader does not take the last frame") from None

    def close(self) -> None:
        """Close the pipe, so that the reader sees the end."""
        if self._descriptor is not None:
            if self._path is None:
                os.set_blocking(self._descriptor, True)
            else:
                os.close(self._descriptor)
            self._descriptor = None

    def _open(self, path: Path) -> int | None:
        """Wait for a reader; None where none came before the stop."""
        while True:
            try:
                return os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            except OSError as error:
                if error.errno != errno.ENXIO:
                    raise VideoError(path, f"cannot be written ({error.strerror})") from None
            if self._stop.wait(WAIT_S):
                return None


def write_all(descriptor: int, data: memoryview, stop: Event) -> None:
    """Write to a descriptor that does not block, waiting while the other side is busy.

    Raises
    ------
    OSError
        What the system says.
    TimeoutError
        If the other side does not take the rest within ``LAST_FRAME_S`` of the stop.
    """
    give_up_s: float | None = None
    while data:
        try:
            data = data[os.write(descriptor, data) :]
        except BlockingIOError:
            if stop.is_set():
                give_up_s = give_up_s or time.monotonic() + LAST_FRAME_S
                if time.monotonic() > give_up_s:
                    raise TimeoutError from None
            select.select([], [descriptor], [], WAIT_S)
