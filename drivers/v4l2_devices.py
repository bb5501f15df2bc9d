"""Which V4L2 cameras there are, and how one is told from another. Needs no OpenCV.

Source of the structures and numbers: Linux, ``include/uapi/linux/videodev2.h``.
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from fcntl import ioctl
from pathlib import Path

from dbc.errors import DeviceError
from drivers.camera import CARD_PREFIX

QUERYCAP = 0x80685600
CAPABILITY = struct.Struct("16s32s32sIII12x")
VIDEO_CAPTURE = 0x0000_0001


@dataclass(frozen=True, slots=True)
class CameraDevice:
    """A V4L2 capture device.

    Attributes
    ----------
    path:
        ``/dev/videoN``; another N may be the same camera after it was unplugged.
    card:
        The camera's model name.
    bus_info:
        Where it is plugged in, e.g. ``usb-0000:00:14.0-2``.
    serial:
        Serial number of a USB camera; empty where there is none.
    """

    path: Path
    card: str
    bus_info: str
    serial: str

    def is_same_camera(self, other: CameraDevice) -> bool:
        """Tell by model and serial number; by model and place where there is no number."""
        if self.serial or other.serial:
            return (self.card, self.serial) == (other.card, other.serial)
        return (self.card, self.bus_info) == (other.card, other.bus_info)


def find_camera(spec: str | Path) -> CameraDevice:
    """Return the camera that ``spec`` names.

    Parameters
    ----------
    spec:
        ``/dev/video0``, ``0``, a link such as ``/dev/v4l/by-id/...``, or ``v4l2:NAME`` with the
        card name, the bus info or the serial number of exactly one camera.

    Raises
    ------
    DeviceError
        If it is missing, not a camera, or may not be opened, or several cameras have that name.
    """
    text = str(spec)
    if text.isdecimal():
        return query_camera(Path(f"/dev/video{text}"))
    if not text.startswith(CARD_PREFIX):
        return query_camera(Path(text))
    name, cameras = text.removeprefix(CARD_PREFIX), list_cameras()
    found = [camera for camera in cameras if name in (camera.card, camera.bus_info, camera.serial)]
    if len(found) == 1:
        return found[0]
    if found:
        places = ", ".join(CARD_PREFIX + camera.bus_info for camera in found)
        raise DeviceError(text, f"{len(found)} cameras have this name", f"choose one of {places}")
    names = ", ".join(CARD_PREFIX + camera.card for camera in cameras) or "no camera"
    raise DeviceError(text, "no camera has this name", f"there is {names}")


def list_cameras() -> list[CameraDevice]:
    """Return the cameras that may be opened, in order of their numbers."""
    paths = Path("/dev").glob("video[0-9]*")
    cameras = []
    for path in sorted(paths, key=lambda path: int(path.name.removeprefix("video"))):
        try:
            cameras.append(query_camera(path))
        except DeviceError:
            continue  # a metadata node or an encoder
    return cameras


def query_camera(path: Path) -> CameraDevice:
    """Ask a device what it is.

    Raises
    ------
    DeviceError
        If it is missing, not a camera, or may not be opened.
    """
    path = path.resolve()
    try:
        handle = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    except PermissionError as error:
        raise DeviceError(path, "permission denied", "add yourself to the group video") from error
    except OSError as error:
        raise DeviceError(path, str(error.strerror).lower(), "is the camera plugged in?") from error
    try:
        answer = ioctl(handle, QUERYCAP, bytes(CAPABILITY.size))
    except OSError as error:
        raise DeviceError(path, "is not a camera", "expected a V4L2 device") from error
    finally:
        os.close(handle)
    _driver, card, bus_info, _version, _all_nodes, this_node = CAPABILITY.unpack(answer)
    if not this_node & VIDEO_CAPTURE:
        raise DeviceError(path, "captures no video", "expected a camera")
    return CameraDevice(path, _text(card), _text(bus_info), _serial(path))


def _text(field: bytes) -> str:
    return field.split(b"\0", 1)[0].decode(errors="replace")


def _serial(path: Path) -> str:
    """Return the serial number of the USB device whose interface ``path`` is."""
    interface = Path("/sys/class/video4linux", path.name, "device").resolve()
    try:
        return (interface.parent / "serial").read_text().strip()
    except OSError:
        return ""
