"""V4L2 without a camera: what is refused, and how; the cameras are in ``tests/vm``."""

from __future__ import annotations

import os
import time
from dataclasses import replace
from pathlib import Path

import pytest

from dbc.errors import DeviceError
from drivers.camera import is_live_camera, open_camera_source
from drivers.v4l2 import wall_minus_monotonic_ns
from drivers.v4l2_devices import CameraDevice, find_camera, list_cameras

CAMERA = CameraDevice(Path("/dev/video0"), "Dash Cam", "usb-0000:00:14.0-1", "")


@pytest.mark.parametrize(
    ("spec", "live"),
    [
        ("0", True),
        ("12", True),
        ("/dev/video3", True),
        (Path("/dev/video3"), True),
        ("/dev/v4l/by-id/usb-Maker_Camera-video-index0", True),
        ("v4l2:Dash Cam", True),
        ("/dev/null", True),
        ("/dev/shm/clip.mp4", False),
        ("clip.mp4", False),
        ("./0", False),
        ("frames", False),
    ],
)
def test_a_live_camera_is_told_from_a_file_by_its_name(spec: str | Path, live: bool) -> None:
    assert is_live_camera(spec) is live


@pytest.mark.parametrize(
    ("spec", "what"),
    [
        ("/dev/video987", "no such file"),
        ("987", "no such file"),
        ("/dev/v4l/by-id/nothing", "no such file"),
        ("/dev/null", "is not a camera"),
        ("v4l2:No Such Camera", "no camera has this name"),
    ],
)
def test_what_is_no_camera_is_refused_in_one_line(spec: str, what: str) -> None:
    with pytest.raises(DeviceError, match=what) as caught:
        open_camera_source(spec, "camera")
    assert "\n" not in str(caught.value)


def test_a_regular_file_is_not_a_camera(tmp_path: Path) -> None:
    path = tmp_path / "video0"
    path.write_bytes(bytes(200))
    with pytest.raises(DeviceError, match="is not a camera"):
        find_camera(path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open every device")
def test_a_device_without_permission_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "video0"
    path.touch(mode=0)
    with pytest.raises(DeviceError, match="permission denied; add yourself"):
        find_camera(path)


def test_only_cameras_are_listed() -> None:
    assert all(camera.path.is_char_device() for camera in list_cameras())


def test_a_camera_with_a_serial_number_is_the_same_at_another_place() -> None:
    first = replace(CAMERA, serial="A1")
    moved = replace(first, path=Path("/dev/video4"), bus_info="usb-0000:00:14.0-7")
    assert first.is_same_camera(moved)
    assert not first.is_same_camera(replace(first, serial="A2"))
    assert not first.is_same_camera(replace(first, card="Other"))
    assert not first.is_same_camera(CAMERA)


def test_a_camera_without_a_serial_number_is_the_same_only_at_its_place() -> None:
    assert CAMERA.is_same_camera(replace(CAMERA, path=Path("/dev/video4")))
    assert not CAMERA.is_same_camera(replace(CAMERA, bus_info="usb-0000:00:14.0-7"))


def test_the_clocks_are_mapped_onto_each_other() -> None:
    before = time.time_ns()
    mapped = time.monotonic_ns() + wall_minus_monotonic_ns()
    after = time.time_ns()
    second = 10**9
    assert before - second < mapped < after + second
