"""What every source of camera frames has in common, and the choice of one by its name."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import ClassVar, Self

from dbc.errors import VideoError
from drivers.frame import Frame

CARD_PREFIX = "v4l2:"
IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".webp", ".tif", ".tiff"})
VIDEO_SUFFIXES = frozenset({".avi", ".h264", ".m4v", ".mkv", ".mov", ".mp4", ".mpg", ".webm"})


class FrameSource(ABC):
    """Frames of one camera, one after the other, as they come: an iterator and context manager.

    Attributes
    ----------
    live:
        True where the frames come at the camera's pace, False where they come as fast as they are
        asked for.
    dropped:
        Frames known to be lost since the source was opened.
    """

    live: ClassVar[bool]
    dropped: int = 0

    def __iter__(self) -> Self:
        return self

    @abstractmethod
    def __next__(self) -> Frame:
        """Return the next frame, waiting for it where the source is live."""

    @abstractmethod
    def close(self) -> None:
        """Release the source; closing twice does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class Recording(FrameSource):
    """A source of frames on disk: read once, to its end; damage is counted and left out.

    It may be closed while another thread reads it: the reader gets no further frame.

    Raises
    ------
    VideoError
        By the constructor, if not one frame can be read.
    """

    live = False

    def __init__(self, path: Path, frames: Iterator[Frame]) -> None:
        first = next(frames, None)
        if first is None:
            raise VideoError(path, "not one picture in it can be decoded", "is it damaged?")
        self._frames = chain((first,), frames)
        self._in_use = Lock()

    def __next__(self) -> Frame:
        with self._in_use:
            return next(self._frames)

    def close(self) -> None:
        """Release the recording; closing twice does nothing."""
        with self._in_use:
            self._frames = chain()
            self._release()

    def _release(self) -> None:
        """Close what the reader holds open."""


def is_live_camera(spec: str | Path) -> bool:
    """Tell the name of a live camera from a file's."""
    text = str(spec)
    named = text.isdecimal() or text.startswith((CARD_PREFIX, "/dev/video", "/dev/v4l/"))
    return named or Path(spec).is_char_device()


def open_camera_source(spec: str | Path, sensor: str) -> FrameSource:
    """Open whatever ``spec`` names, importing only the library that it needs.

    Parameters
    ----------
    spec:
        A video file, an image, a folder of images, or a live camera
        (``drivers.v4l2_devices.find_camera``).
    sensor:
        The camera's name in the scene.

    Raises
    ------
    VideoError
        If a file or folder is missing, unreadable or holds no picture.
    DeviceError
        If a camera is missing, busy or not a camera.
    """
    if is_live_camera(spec):
        from drivers.v4l2 import V4L2Camera

        return V4L2Camera(spec, sensor)
    path = Path(spec)
    if path.is_dir() or path.suffix.lower() in IMAGE_SUFFIXES:
        from drivers.images import ImageFolder

        return ImageFolder(path, sensor)
    from drivers.video import open_video

    return open_video(path, sensor)


def natural_key(name: str) -> list[tuple[int, str]]:
    """Return what sorts ``2.png`` before ``10.png``."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), part) if part.isdecimal() else (-1, part) for part in parts]
