"""V4L2 output devices: what is shown there, another program sees as a camera or a display.

Source of the structures and numbers: Linux, ``include/uapi/linux/videodev2.h``. Frames go through
mapped buffers, since ``write`` does not work with every driver (vivid refuses it).
"""

from __future__ import annotations

import errno
import mmap
import os
import select
import struct
import time
from fcntl import ioctl
from pathlib import Path
from threading import Event

import numpy as np
from numpy.typing import NDArray

from dbc.errors import DeviceError
from drivers.frame_sink import LAST_FRAME_S, WAIT_S, FrameSink, SinkGone
from drivers.v4l2_devices import CAPABILITY, QUERYCAP

_SET_FORMAT, _REQUEST_BUFFERS, _QUERY_BUFFER = 0xC0D05605, 0xC0145608, 0xC0585609
_QUEUE, _DEQUEUE, _STREAM_ON = 0xC058560F, 0xC0585611, 0x40045612
_VIDEO_OUTPUT, _STREAMING = 0x0000_0002, 0x0400_0000
_OUTPUT_TYPE, _MAPPED, _FIELD_NONE = 2, 1, 1
_BUFFERS = 4
_FORMAT = struct.Struct("=I4x2I4s3I176x")
"""``struct v4l2_format``: type; width, height, pixelformat, field, bytesperline, sizeimage."""
_REQUEST = struct.Struct("=3I8x")
"""``struct v4l2_requestbuffers``: count, type, memory."""
_BUFFER = struct.Struct("=5I40xIQI12x")
"""``struct v4l2_buffer``: index, type, bytesused, flags, field; memory, offset, length."""
BGR, YUYV = b"BGR3", b"YUYV"


class V4L2Output(FrameSink):
    """A V4L2 output device.

    Frames are shown as BGR where the device takes that, else as YUYV, in the frames' own size.

    Raises
    ------
    DeviceError
        If it is missing or takes no video; by ``write``, if it is busy or does not take the size.
    """

    live = True

    def __init__(self, path: Path, stop: Event) -> None:
        self._path = path
        self._stop = stop
        self._shape: tuple[int, ...] | None = None
        self._maps: list[mmap.mmap] = []
        self._free: list[int] = []
        self._streams = False
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
            self._map_buffers()
            self._shape = image.shape
        if image.shape != self._shape:
            raise DeviceError(self._path, "the frames' size changes", "a device has one size")
        rows = self._packed(image)
        try:
            index = self._free.pop() if self._free else self._shown()
            self._maps[index][: rows.nbytes] = rows.tobytes()
            self._buffer(_QUEUE, index, rows.nbytes)
            if not self._streams:
                ioctl(self._handle, _STREAM_ON, struct.pack("=I", _OUTPUT_TYPE))
                self._streams = True
        except OSError as error:
            raise SinkGone(f"{self._path}: takes no frames ({error.strerror})") from None

    def close(self) -> None:
        """Release the device."""
        for mapped in self._maps:
            mapped.close()
        self._maps = []
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def _check(self) -> None:
        try:
            answer = ioctl(self._handle, QUERYCAP, bytes(CAPABILITY.size))
        except OSError:
            raise DeviceError(self._path, "is not a V4L2 device") from None
        capabilities = CAPABILITY.unpack(answer)[-1]
        if not (capabilities & _VIDEO_OUTPUT and capabilities & _STREAMING):
            raise DeviceError(self._path, "takes no video", "expected a V4L2 output device")

    def _negotiate(self, width: int, height: int) -> None:
        """Agree with the device on a format for frames of this size."""
        for pixel_format, bytes_per_pixel in ((BGR, 3), (YUYV, 2)):
            row, size = width * bytes_per_pixel, width * height * bytes_per_pixel
            wanted = (width, height, pixel_format, _FIELD_NONE, row, size)
            try:
                answer = ioctl(self._handle, _SET_FORMAT, _FORMAT.pack(_OUTPUT_TYPE, *wanted))
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

    def _map_buffers(self) -> None:
        try:
            request = _REQUEST.pack(_BUFFERS, _OUTPUT_TYPE, _MAPPED)
            count = _REQUEST.unpack(ioctl(self._handle, _REQUEST_BUFFERS, request))[0]
            for index in range(count):
                *_, offset, length = self._buffer(_QUERY_BUFFER, index)
                self._maps.append(mmap.mmap(self._handle, length, offset=offset))
        except OSError as error:
            raise DeviceError(self._path, f"gives no buffers ({error.strerror})") from None
        self._free = list(range(count))

    def _buffer(self, request: int, index: int, size: int = 0) -> tuple[int, ...]:
        """Do something with a buffer, and return what the driver says of it."""
        wanted = _BUFFER.pack(index, _OUTPUT_TYPE, size, 0, _FIELD_NONE, _MAPPED, 0, 0)
        return _BUFFER.unpack(ioctl(self._handle, request, wanted))

    def _shown(self) -> int:
        """Wait until the device has shown a buffer, and return which.

        Raises
        ------
        OSError
            What the driver says; ETIMEDOUT where it shows none within ``LAST_FRAME_S`` of the stop.
        """
        give_up_s: float | None = None
        while True:
            try:
                return self._buffer(_DEQUEUE, 0)[0]
            except BlockingIOError:
                select.select([], [self._handle], [], WAIT_S)
            if self._stop.is_set():
                give_up_s = give_up_s or time.monotonic() + LAST_FRAME_S
                if time.monotonic() > give_up_s:
                    raise TimeoutError(errno.ETIMEDOUT, "it hangs")

    def _packed(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the image as the device wants it, (height, bytes per row)."""
        if self._pixel_format == YUYV:
            import cv2

            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2YUV_YUYV), np.uint8)
        rows = np.ascontiguousarray(image).reshape(len(image), -1)
        return np.pad(rows, ((0, 0), (0, self._row_bytes - rows.shape[1])))
