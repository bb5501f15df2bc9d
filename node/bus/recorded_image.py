"""Images as recordings hold them: murk's are raw, those of other programs raw or compressed.

Compressing a chunk of raw pixels takes a fraction of the time that PNG takes.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.store import Typestore

from dbc.errors import InputError
from drivers.frame import Frame
from node.bus.messages import deserialize, serialize, to_ros
from node.bus.scan_message import ros_time, time_ns_of

RAW = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"

_TO_BGR = {
    "bgr8": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "mono8": (1, cv2.COLOR_GRAY2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
}
"""By encoding: bytes a pixel, and the conversion."""


def read_image(
    type_name: str, cdr: bytes, info: bytes | None, count: int, store: Typestore
) -> Frame:
    """Return the frame of a ``CompressedImage`` or ``Image``; its sensor is the ``frame_id``.

    Parameters
    ----------
    info:
        CDR of the ``FrameInfo`` beside it, where murk recorded it.
    count:
        The sequence of a frame without.

    Raises
    ------
    InputError
        If the bytes are malformed, or the format or encoding is not read.
    """
    message = deserialize(type_name, cdr, store)
    pixels = _raw(message) if type_name == RAW else _decompressed(message)
    stamp_ns = time_ns_of(message.header.stamp)
    if info is None:
        return Frame(pixels, message.header.frame_id, count, stamp_ns, "file")
    beside = deserialize("murk_msgs/msg/FrameInfo", info, store)
    return Frame(
        image=pixels,
        sensor=beside.header.frame_id,
        sequence=beside.sequence,
        stamp_ns=stamp_ns,
        stamp_source=beside.stamp_source,
        dropped=beside.dropped,
    )


def image_cdr(frame: Frame, type_name: str, store: Typestore) -> bytes:
    """Return a frame as a message of that type, without loss."""
    if type_name != RAW:
        return to_ros(frame, store, lossless=True).cdr
    types = store.types
    height, width, _ = frame.image.shape
    header = types["std_msgs/msg/Header"](ros_time(frame.stamp_ns, store), frame.sensor)
    pixels = np.ascontiguousarray(frame.image).reshape(-1)
    return serialize(types[RAW](header, height, width, "bgr8", 0, 3 * width, pixels), store).cdr


def _decompressed(message: Any) -> NDArray[np.uint8]:
    data = np.asarray(message.data)
    image: Any = cv2.imdecode(data, cv2.IMREAD_COLOR_BGR) if len(data) else None
    if image is None:
        raise InputError(COMPRESSED, f"the format '{message.format}' is not read")
    pixels: NDArray[np.uint8] = image
    return pixels


def _raw(message: Any) -> NDArray[np.uint8]:
    if message.encoding not in _TO_BGR:
        expected = f"expected {', '.join(_TO_BGR)}"
        raise InputError(RAW, f"the encoding '{message.encoding}' is not read", expected)
    channels, conversion = _TO_BGR[message.encoding]
    height, width = message.height, message.width
    try:
        rows = np.asarray(message.data).reshape(height, message.step)
        pixels = rows[:, : width * channels].reshape(height, width, channels)
    except ValueError:
        raise InputError(RAW, f"is no image of {width} × {height} pixels") from None
    return (
        pixels.copy()
        if conversion is None
        else np.asarray(cv2.cvtColor(pixels, conversion), np.uint8)
    )
