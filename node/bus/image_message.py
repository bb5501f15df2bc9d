"""A camera frame as a ``sensor_msgs/CompressedImage`` and a ``murk_msgs/FrameInfo``, and back."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from rosbags.typesys.store import Typestore

from drivers.frame import Frame
from node.bus.scan_message import drawn_of, injected_fields, injected_of, ros_time, time_ns_of

JPEG_QUALITY = 90
"""Of 100; OpenCV's own default of 95 takes half as many bytes again."""
_JPEG = (".jpg", [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
_PNG = (".png", [cv2.IMWRITE_PNG_COMPRESSION, 1])


def image_message(frame: Frame, store: Typestore, *, lossless: bool) -> Any:
    """Return a frame as JPEG, or as PNG where it shall be lossless.

    ``format`` reads as ROS's image transport writes it, so that its republishers take it.
    """
    suffix, options = _PNG if lossless else _JPEG
    _, encoded = cv2.imencode(suffix, frame.image, options)
    types = store.types
    return types["sensor_msgs/msg/CompressedImage"](
        header=types["std_msgs/msg/Header"](ros_time(frame.stamp_ns, store), frame.sensor),
        format=f"bgr8; {'png' if lossless else 'jpeg'} compressed bgr8",
        data=encoded.reshape(-1),
    )


def frame_info_message(frame: Frame, store: Typestore) -> Any:
    """Return what a frame carries beside its image."""
    types = store.types
    header = types["std_msgs/msg/Header"](ros_time(frame.stamp_ns, store), frame.sensor)
    return types["murk_msgs/msg/FrameInfo"](
        header,
        frame.sequence,
        frame.stamp_source,
        frame.dropped,
        **injected_fields(frame),
    )


def parse_frame(message: Any, info: Any) -> Frame:
    """Return the frame of an image and what came beside it.

    Raises
    ------
    ValueError
        If the bytes are no image.
    """
    if not len(message.data):
        raise ValueError("the image is empty")
    image: Any = cv2.imdecode(np.asarray(message.data), cv2.IMREAD_COLOR_BGR)
    if image is None:
        raise ValueError("the bytes are no image")
    return Frame(
        image=image,
        sensor=info.header.frame_id,
        sequence=info.sequence,
        stamp_ns=time_ns_of(info.header.stamp),
        stamp_source=info.stamp_source,
        dropped=info.dropped,
        injected=injected_of(info),
        drawn=drawn_of(info),
    )
