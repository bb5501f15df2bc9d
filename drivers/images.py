"""Image folders and single images as a source of frames."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dbc.errors import VideoError
from drivers.camera import IMAGE_SUFFIXES, Recording, natural_key
from drivers.frame import Frame


class ImageFolder(Recording):
    """The images of a folder in natural order, or one image; they may differ in size.

    Parameters
    ----------
    path:
        A folder, or one image file.
    sensor:
        The camera's name in the scene.
    rate_hz:
        Images have no time of their own: the stamps start at 0 and advance by ``1 / rate_hz``.

    Attributes
    ----------
    dropped:
        Images so far that could not be decoded. They are left out; ``Frame.sequence`` counts them.

    Raises
    ------
    VideoError
        If the folder cannot be read, holds no image, or not one of them decodes.
    """

    def __init__(self, path: Path, sensor: str, rate_hz: float = 10.0) -> None:
        self.sensor = sensor
        self.rate_hz = rate_hz
        super().__init__(path, self._read(list_images(path)))

    def _read(self, paths: list[Path]) -> Iterator[Frame]:
        for sequence, path in enumerate(paths):
            image = read_image(path)
            if image is None:
                self.dropped += 1
                continue
            stamp_ns = round(sequence * 10**9 / self.rate_hz)
            yield Frame(image, self.sensor, sequence, stamp_ns, "file", self.dropped)


def read_image(path: Path) -> NDArray[np.uint8] | None:
    """Return an image as (height, width, 3) uint8 BGR, or None if it cannot be read or decoded."""
    try:
        content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
        image = cv2.imdecode(content, cv2.IMREAD_COLOR) if content.size else None
    except (OSError, cv2.error):  # OpenCV raises at a header that promises too large a picture
        return None
    return None if image is None else image.astype(np.uint8, copy=False)


def list_images(path: Path) -> list[Path]:
    """Return the images of a folder in natural order (``2.png`` before ``10.png``), or the one.

    Raises
    ------
    VideoError
        If the folder or the image cannot be opened, or the folder holds no image.
    """
    try:
        if not path.is_dir():
            path.open("rb").close()
            return [path]
        paths = [entry for entry in path.iterdir() if entry.suffix.lower() in IMAGE_SUFFIXES]
    except OSError as error:
        raise VideoError(path, str(error.strerror).lower(), "expected images") from error
    if not paths:
        raise VideoError(path, "holds no image", f"expected {' '.join(sorted(IMAGE_SUFFIXES))}")
    return sorted(paths, key=lambda entry: natural_key(entry.name))
