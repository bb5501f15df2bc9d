"""Video files written through PyAV, each frame with its own stamp."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self, cast

import av
import numpy as np
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from numpy.typing import NDArray

from dbc.errors import VideoError

TICK_NS = {".mp4": 1_000, ".mkv": 1_000_000}
"""To what stamps are kept, by suffix: finer, and MP4 cannot hold a gap of five seconds; Matroska
is written to the millisecond."""
_FORMATS = {".mp4": "mp4", ".mkv": "matroska"}

QUALITY = "18"
"""x264's constant rate factor: near the eye's limit, so that noise is kept."""

NOMINAL_RATE = 25
"""Only a hint to the encoder; the stamps say when a frame is shown."""


class VideoWriter:
    """Write an MP4 or Matroska file (H.264), which appears under its name once it is complete.

    Use it as a context manager: leaving it by an exception leaves no file.

    Parameters
    ----------
    path:
        Where the file is to be; an older file there is replaced. Matroska where it ends in
        ``.mkv``.
    lossless:
        Keep every pixel to the bit (H.264 in RGB, several times larger).
    threads:
        Of the encoder; 0: one a core. The bytes of the file, not its pixels, depend on it.

    Raises
    ------
    VideoError
        If the file cannot be made.
    """

    def __init__(self, path: Path, *, lossless: bool = False, threads: int = 0) -> None:
        self.path = path
        self._lossless = lossless
        self._threads = threads
        self._unfinished = path.with_name(f".{path.name}.part")
        self._stream: VideoStream | None = None
        self._last_pts: int | None = None
        self._closed = False
        try:
            self._unfinished.touch()
        except OSError as error:
            raise self._failure(error) from error
        suffix = path.suffix.lower()
        self._tick_ns = TICK_NS.get(suffix, TICK_NS[".mp4"])
        container_format = _FORMATS.get(suffix, "mp4")
        self._container = av.open(str(self._unfinished.absolute()), "w", format=container_format)

    def write(self, image: NDArray[np.uint8], stamp_ns: int) -> None:
        """Append a frame.

        Parameters
        ----------
        image:
            (height, width, 3) uint8, BGR; the first frame sets the size.
        stamp_ns:
            Nanoseconds; later than the frame before it by at least ``TICK_NS``.

        Raises
        ------
        VideoError
            If the size changes, the stamp does not advance, or the file cannot be written.
        """
        height, width = image.shape[:2]
        if self._stream is None:
            self._stream = self._add_stream(width, height)
        if (width, height) != (self._stream.width, self._stream.height):
            size = f"{self._stream.width}x{self._stream.height}"
            raise VideoError(self.path, f"a frame is {width}x{height}", f"expected {size}")
        pts = stamp_ns // self._tick_ns
        if self._last_pts is not None and pts <= self._last_pts:
            raise VideoError(self.path, f"stamp {stamp_ns} ns is not after the one before it")
        self._last_pts = pts
        frame = VideoFrame.from_ndarray(np.ascontiguousarray(image), format="bgr24")
        frame.pts, frame.time_base = pts, self._time_base
        self._encode(self._stream, frame)

    def close(self) -> None:
        """Finish the file and give it its name; closing twice does nothing.

        Raises
        ------
        VideoError
            If the file cannot be written, or there was no frame to write.
        """
        if self._closed:
            return
        if self._stream is None:
            self.discard()
            raise VideoError(self.path, "no frame was written")
        try:
            self._encode(self._stream, None)
            self._container.close()
            self._unfinished.replace(self.path)
        except OSError as error:
            raise self._failure(error) from error
        self._closed = True

    def discard(self) -> None:
        """Stop and leave no file."""
        self._closed = True
        self._container.close()
        self._unfinished.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            self.close()
        else:
            self.discard()

    @property
    def _time_base(self) -> Fraction:
        return Fraction(self._tick_ns, 10**9)

    def _add_stream(self, width: int, height: int) -> VideoStream:
        codec = "libx264rgb" if self._lossless else "libx264"
        options = {"qp": "0"} if self._lossless else {"crf": QUALITY}
        stream = cast(
            VideoStream, self._container.add_stream(codec, rate=NOMINAL_RATE, options=options)
        )
        if self._lossless:
            stream.pix_fmt = "bgr24"
        else:  # chroma can only be halved where the size is even
            stream.pix_fmt = "yuv420p" if width % 2 == height % 2 == 0 else "yuv444p"
        stream.width, stream.height = width, height
        stream.codec_context.thread_count = self._threads
        stream.codec_context.time_base = self._time_base
        return stream

    def _encode(self, stream: VideoStream, frame: VideoFrame | None) -> None:
        try:
            self._container.mux(stream.encode(frame))
        except OSError as error:
            raise self._failure(error) from error

    def _failure(self, error: OSError) -> VideoError:
        return VideoError(self.path, str(error.strerror).lower(), "choose another place")
