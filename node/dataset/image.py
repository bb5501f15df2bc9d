"""Jobs on single images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dbc.errors import VideoError
from node.dataset.job import Job

Image = NDArray[np.uint8]

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
    """Write the degraded image, in the form of the original; return its label.

    Its pixels lie as they lay, whatever its EXIF data say of turning it; these and its transparency
    stay. A gray one is degraded as three equal channels, and the first of them is written. An image
    to which nothing happens is copied byte by byte.

    Raises
    ------
    VideoError
        If the image cannot be read or written, or has more than 8 bits a value.
    """
    cv2.setNumThreads(1)  # the processes beside this one have the other cores
    source = job.source
    content = np.frombuffer(source.path.read_bytes(), np.uint8)
    image, exif = _decoded(content, source.path)
    colour = np.ascontiguousarray(image[..., :3] if image.ndim == 3 else np.dstack([image] * 3))
    degraded, label = job.degrade(colour, source.sensor, source.sequence)
    if degraded is colour:
        path.write_bytes(content.tobytes())
    else:
        suffix = source.path.suffix.lower()
        kinds, options = [cv2.IMAGE_METADATA_EXIF] * len(exif), _OPTIONS.get(suffix, [])
        written, coded = cv2.imencodeWithMetadata(
            suffix, _like(image, degraded), kinds, exif, options
        )
        if not written:
            raise VideoError(source.path, f"cannot be written as {suffix}", "convert it first")
        path.write_bytes(coded.tobytes())
    return [label]


def _decoded(content: Image, path: Path) -> tuple[Image, list[Any]]:
    """Return an image as it is stored, and its EXIF data where it has some."""
    image, exif = None, []
    if content.size:
        image, kinds, beside = cv2.imdecodeWithMetadata(content, flags=cv2.IMREAD_UNCHANGED)
        told = zip(np.ravel(kinds), beside, strict=True)
        exif = [part for kind, part in told if kind == cv2.IMAGE_METADATA_EXIF]
    if image is None:
        raise VideoError(path, "no image in it can be decoded", "is it damaged?")
    if image.dtype != np.uint8:
        raise VideoError(path, f"has values of {image.dtype}", "expected 8 bits a value")
    return np.asarray(image, np.uint8), exif


def _like(original: Image, degraded: Image) -> Image:
    """Return the degraded colours in the form of the original: gray, or with its transparency."""
    if original.ndim == 2:
        return np.ascontiguousarray(degraded[..., 0])
    return np.dstack([degraded, original[..., 3:]])
