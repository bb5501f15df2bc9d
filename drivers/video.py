"""Video files through PyAV, with the exact presentation stamps of the file."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from heapq import heappop, heappush
from pathlib import Path

import av
import numpy as np
from av.container import InputContainer
from av.packet import Packet
from av.stream import Disposition
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream

from dbc.errors import VideoError
from drivers.camera import Recording
from drivers.frame import Frame

DECODER_THREADS = 2
TEXT_ART_FORMATS = {"adf", "bin", "idf", "tty", "xbin"}
"""Containers by which FFmpeg draws any text file as a picture."""


def open_video(path: Path, sensor: str) -> VideoFile:
    """Open a video file and decode its first frame.

    Raises
    ------
    VideoError
        If the file cannot be read, is not a video, or not one of its frames decodes.
    """
    try:
        container = av.open(str(path.absolute()), metadata_errors="replace")
    except OSError as error:
        raise VideoError(path, str(error.strerror).lower(), "expected a video file") from error
    except av.FFmpegError as error:
        raise VideoError(path, "is not a video, or its header is cut off") from error
    try:
        return VideoFile(path, sensor, container)
    except BaseException:
        container.close()
        raise


class VideoFile(Recording):
    """The frames of one video file in order of presentation; ``open_video`` makes it.

    A file that is cut off yields what it has and ends.

    Attributes
    ----------
    dropped:
        Frames so far that the file holds and that do not decode, or only with parts made up; at
        the end also those that its header promised and that never came. They are left out;
        ``Frame.sequence`` counts them.
    """

    def __init__(self, path: Path, sensor: str, container: InputContainer) -> None:
        self.sensor = sensor
        self._container = container
        self._stream = _find_stream(path, container)
        self._pending: list[int] = []
        self._reformatter = VideoReformatter()
        super().__init__(path, self._decode())

    def _release(self) -> None:
        self._container.close()

    def _decode(self) -> Iterator[Frame]:
        delivered = discarded = 0
        for packet in self._packets():
            discarded += packet.is_discard
            if packet.pts is not None and not packet.is_discard:
                heappush(self._pending, packet.pts)
            try:
                pictures = packet.decode()
            except av.FFmpegError:
                self.dropped += packet.pts is None and packet.size > 0
                continue
            for picture in pictures:
                if picture.is_corrupt:
                    self.dropped += picture.pts is None
                    continue
                self._count_missing_before(picture.pts)
                yield self._frame(picture, delivered + self.dropped)
                delivered += 1
        self.dropped += len(self._pending)
        self.dropped += max(0, self._stream.frames - delivered - discarded - self.dropped)

    def _packets(self) -> Iterator[Packet[VideoStream]]:
        try:
            yield from self._container.demux(self._stream)
        except av.FFmpegError:
            return  # cut off: what came until here is what there is

    def _count_missing_before(self, pts: int | None) -> None:
        """Count packets that should have been shown before ``pts`` and never came out.

        The decoder reports an error only for the broken packet itself, not for the frames that
        it then withholds because they were predicted from it.
        """
        if pts is None:
            return
        while self._pending and self._pending[0] < pts:
            heappop(self._pending)
            self.dropped += 1
        if self._pending and self._pending[0] == pts:
            heappop(self._pending)

    def _frame(self, picture: VideoFrame, sequence: int) -> Frame:
        bgr = self._reformatter.reformat(picture, format="bgr24", threads=1)
        return Frame(
            image=bgr.to_ndarray().astype(np.uint8, copy=False),
            sensor=self.sensor,
            sequence=sequence,
            stamp_ns=self._stamp_ns(picture, sequence),
            stamp_source="file",
            dropped=self.dropped,
        )

    def _stamp_ns(self, picture: VideoFrame, sequence: int) -> int:
        """Return the presentation time; a bare stream without any is timed by its frame rate."""
        if picture.pts is not None and picture.time_base is not None:
            return round(picture.pts * picture.time_base * 10**9)
        rate = self._stream.guessed_rate or Fraction(25)
        return round(sequence * 10**9 / rate)


def _find_stream(path: Path, container: InputContainer) -> VideoStream:
    if container.format.name in TEXT_ART_FORMATS:
        raise VideoError(path, "is not a video")
    for stream in container.streams.video:
        if not stream.disposition & Disposition.attached_pic:
            stream.thread_type = "AUTO"
            stream.codec_context.thread_count = DECODER_THREADS
            return stream
    raise VideoError(path, "has no video in it", "expected a video file")
