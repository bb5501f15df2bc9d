"""Jobs on single images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2

from dbc.errors import VideoError
from drivers.images import read_image
from node.dataset.job import Job

_JPEG = [
    cv2.IMWRITE_JPEG_QUALITY,
    100,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
]
"""Nothing else keeps noise: with halved chroma even quality 95 takes two thirds of it away."""

_OPTIONS = {".jpg": _JPEG, ".jpeg": _JPEG, ".webp": [cv2.IMWRITE_WEBP_QUALITY, 101]}
"""Options by suffix; a WebP quality over 100 is lossless. The other formats always are."""


def degrade(job: Job, path: Path) -> list[dict[str, Any]]:
    """Write the degraded image, in the format of the original; return its label.

    An image to which nothing happens is copied byte by byte.

    Raises
    ------
    VideoError
        If the image cannot be read.
    """
    cv2.setNumThreads(1)  # the processes beside this one have the other cores
    source = job.source
    image = read_image(source.path)
    if image is None:
        raise VideoError(source.path, "no image in it can be decoded", "is it damaged?")
    degraded, label = job.degrade(image, source.sensor, source.sequence)
    if degraded is image:
        path.write_bytes(source.path.read_bytes())
    else:
        suffix = source.path.suffix.lower()
        _, content = cv2.imencode(suffix, degraded, _OPTIONS.get(suffix, []))
        path.write_bytes(content.tobytes())
    return [label]
