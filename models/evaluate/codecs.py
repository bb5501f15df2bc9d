"""What else cameras make of a picture: no colour, and the JPEG and H.264 on the way to murk."""

from __future__ import annotations

import io

import av
import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]

_SMALLEST_VIDEO = 16


def gray(image: Image) -> Image:
    """Return a frame as a camera without colour delivers it: its brightness in all channels."""
    return np.asarray(cv2.merge([cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)] * 3), np.uint8)


def one_channel(image: Image) -> Image:
    """Return a degraded frame of a camera without colour: what befell one channel, in all."""
    return np.asarray(cv2.merge([image[..., 0]] * 3), np.uint8)


def jpeg(image: Image, quality: int) -> Image:
    """Return the picture after JPEG at a quality of 0 to 100."""
    _, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR), np.uint8)


def h264(image: Image, crf: int) -> Image:
    """Return the third frame of an H.264 video in which the picture slides by two pixels a frame.

    Without x264's look-ahead, with which the result is not always the same. A picture of less
    than 16 pixels in height or width comes back as it is.

    Parameters
    ----------
    crf:
        libx264's constant rate factor; 23 is its default, more is coarser.
    """
    height, width = (length // 2 * 2 for length in image.shape[:2])
    if min(height, width) < _SMALLEST_VIDEO:
        return image
    file = io.BytesIO()
    with av.open(file, "w", format="matroska") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.options = {
            "crf": str(crf),
            "preset": "veryfast",
            "tune": "zerolatency",
            "threads": "1",
        }
        for shift in (-4, -2, 0):
            moved = np.ascontiguousarray(np.roll(image, shift, axis=1)[:height, :width])
            container.mux(stream.encode(av.VideoFrame.from_ndarray(moved, format="bgr24")))
        container.mux(stream.encode())
    file.seek(0)
    with av.open(file, "r") as video:
        *_, last = video.decode(video=0)
        return np.asarray(last.to_ndarray(format="bgr24"), np.uint8)
