"""V4L2 output devices: what is written there, another program sees as a camera or a display.

Source of the structures and numbers: Linux, ``include/uapi/linux/videodev2.h``.
"""

from __future__ import annotations

import errno
import os
import struct
from fcntl import ioctl
from pathlib import Path
from threading import Event

import numpy as np
from numpy.typing import NDArray

from dbc.errors import DeviceError
from drivers.frame_sink import FrameSink, SinkGone, write_all
from drivers.v4l2_devices import CAPABILITY, QUERYCAP

SET_FORMAT = 0xC0D05605
VIDEO_OUTPUT = 0x0000_0002
READ_WRITE = 0x0100_0000
_OUTPUT_TYPE = 2
_FIELD_NONE = 1
_FORMAT = struct.Struct("=I4x2I4s3I176x")
"""``struct v4l2_format``: type; width, height, pixelformat, field, bytesperline, sizeimage."""
BGR, YUYV = b"BGR3", b"YUYV"


class V4L2Output(FrameSink):
    """A V4L2 output device that takes frames by ``write``, as v4l2loopback and vivid have.

    Frames are sent as BGR where the device takes that, else as YUYV, in the frames' own size.

    Raises
    ------
    DeviceError
        If it is missing, busy, or takes no video; by ``write``, if it does not take this size.
    """

    live = True

    def __init__(self, path: Path, stop: Event) -> None:
        self._path = path
        self._stop = stop
        self._shape: tuple[int, ...] | None = None
        try:
            self._handle = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        except PermissionError:
            raise DeviceError(
                path, "permission denied", "add yourself to the group video"
            ) from None
        except OSError as error:
            remedy = "v4l2-ctl --list-devices shows what there is"
            raise DeviceError(path, str(error.strerror).lower(), remedy) from None
        try:
            self._check()
        except DeviceError:
            self.close()
            raise

    def write(self, image: NDArray[np.uint8], stamp_ns: int) -> None:
        """Show a frame; see ``FrameSink``."""
        if self._shape is None:
            self._negotiate(image.shape[1], image.shape[0])
            self._shape = image.shape
        if image.shape != self._shape:
            raise DeviceError(self._path, "the frames' size changes", "a device has one size")
        try:
            write_all(self._handle, self._packed(image).data.cast("B"), self._stop)
        except OSError as error:
            raise SinkGone(f"{self._path}: takes no frames ({error.strerror})") from None

    def close(self) -> None:
        """Release the device."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def _check(self) -> None:
        try:
            answer = ioctl(self._handle, QUERYCAP, bytes(CAPABILITY.size))
        except OSError:
            raise DeviceError(self._path, "is not a V4L2 device") from None
        capabilities = CAPABILITY.unpack(answer)[-1]
        if not capabilities & VIDEO_OUTPUT:
            raise DeviceError(self._path, "takes no video", "expected a V4L2 output device")
        if not capabilities & READ_WRITE:
            raise DeviceError(self._path, "takes no frames by write()", "v4l2loopback does")

    def _negotiate(self, width: int, height: int) -> None:
        """Agree with the device on a format for frames of this size."""
        for pixel_format, bytes_per_pixel in ((BGR, 3), (YUYV, 2)):
            row, size = width * bytes_per_pixel, width * height * bytes_per_pixel
            wanted = (width, height, pixel_format, _FIELD_NONE, row, size)
            try:
                answer = ioctl(self._handle, SET_FORMAT, _FORMAT.pack(_OUTPUT_TYPE, *wanted))
            except OSError as error:
                if error.errno == errno.EBUSY:
                    raise DeviceError(self._path, "is busy", "is it in use elsewhere?") from None
                continue
            _, *given = _FORMAT.unpack(answer)
            if tuple(given[:3]) == wanted[:3]:
                self._pixel_format, self._row_bytes = pixel_format, given[4]
                return
        took = f"takes no frames of {width}x{height} in BGR or YUYV"
        raise DeviceError(self._path, took, "v4l2-ctl --list-formats-out shows what it takes")

    def _packed(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the image as the device wants it, (height, bytes per row)."""
        if self._pixel_format == YUYV:
            import cv2

            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2YUV_YUYV), np.uint8)
        rows = np.ascontiguousarray(image).reshape(len(image), -1)
        return np.pad(rows, ((0, 0), (0, self._row_bytes - rows.shape[1])))
