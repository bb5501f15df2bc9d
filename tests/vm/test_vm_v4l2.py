"""The V4L2 driver against vivid, the kernel's own test camera (640 × 480 at 25 Hz by default)."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Iterator
from itertools import islice
from threading import Thread
from typing import TYPE_CHECKING

import numpy as np
import pytest

from dbc.errors import DeviceError
from tests.vm.marks import INSIDE, needs_machine

if INSIDE or TYPE_CHECKING:
    from drivers.camera import open_camera_source
    from drivers.v4l2 import CameraLost, CameraStalled, V4L2Camera
    from drivers.v4l2_devices import list_cameras

pytestmark = needs_machine

PERIOD_NS = 40_000_000
DEFAULTS = "percentage_of_dropped_buffers=0,osd_text_mode=0,timestamp_source=1"


def control(setting: str, device: str = "/dev/video0") -> None:
    subprocess.run(["v4l2-ctl", "-d", device, "-c", setting], check=True)


@pytest.fixture
def camera() -> Iterator[V4L2Camera]:
    control(DEFAULTS)
    with V4L2Camera("/dev/video0", "front") as camera:
        yield camera
    control(DEFAULTS)


def test_frames_come_with_the_drivers_stamps_at_the_negotiated_rate(camera: V4L2Camera) -> None:
    before = time.time_ns()
    frames = list(islice(camera, 12))
    after = time.time_ns()
    assert {frame.stamp_source for frame in frames} == {"device"}
    assert {(frame.sensor, frame.image.shape) for frame in frames} == {("front", (480, 640, 3))}
    stamps = np.array([frame.stamp_ns for frame in frames])
    assert before - PERIOD_NS < stamps[0] < stamps[-1] < after
    assert (np.diff(stamps) > 0).all()
    per_frame = (stamps[-1] - stamps[0]) / (frames[-1].sequence - frames[0].sequence)
    assert per_frame == pytest.approx(PERIOD_NS, rel=0.1)
    assert camera.nominal_rate_hz == pytest.approx(25)
    assert camera.frozen == 0


def test_a_stalled_reader_counts_the_frames_that_it_missed(camera: V4L2Camera) -> None:
    first = next(camera)
    time.sleep(2)
    last = list(islice(camera, 8))[-1]
    elapsed = round((last.stamp_ns - first.stamp_ns) / PERIOD_NS)
    advanced = last.sequence - first.sequence
    assert advanced == pytest.approx(elapsed, abs=1)  # the emulated clock may stumble
    assert last.dropped - first.dropped == advanced - 8
    assert last.dropped >= 40


def test_dropped_buffers_are_counted(camera: V4L2Camera) -> None:
    first = next(camera)
    control("percentage_of_dropped_buffers=50")
    last = list(islice(camera, 25))[-1]
    elapsed = round((last.stamp_ns - first.stamp_ns) / PERIOD_NS)
    assert last.sequence - first.sequence == pytest.approx(elapsed, rel=0.1)
    assert last.dropped == last.sequence - 25 > 5


def test_a_camera_without_frames_is_stalled_and_goes_on_afterwards(camera: V4L2Camera) -> None:
    next(camera)
    control("percentage_of_dropped_buffers=100")
    with pytest.raises(CameraStalled, match="no frame for 1 s"):
        list(islice(camera, 8))  # up to four are still in the driver's queue
    control("percentage_of_dropped_buffers=0")
    assert next(camera).dropped > 20


def test_a_slow_camera_is_not_a_stalled_one() -> None:
    with V4L2Camera("/dev/video1", "slow", size=(640, 360), rate_hz=2) as camera:
        stamps = [frame.stamp_ns for frame in islice(camera, 4)]
        assert camera.nominal_rate_hz == pytest.approx(2)
    assert np.diff(stamps) == pytest.approx(0.5e9, rel=0.1)


def test_a_picture_that_stands_still_is_told(camera: V4L2Camera) -> None:
    next(camera)
    control("osd_text_mode=2")  # without its running clock vivid's picture is always the same
    for _ in camera:
        if camera.frozen == 3:
            break
    control("osd_text_mode=0")
    for _ in camera:
        if camera.frozen == 0:
            break


def test_unplugging_is_told_and_the_same_camera_comes_back(camera: V4L2Camera) -> None:
    first = next(camera)
    control("disconnect=1")
    with pytest.raises(CameraLost, match="lost camera vivid"):
        list(islice(camera, 8))
    with pytest.raises(CameraLost):
        next(camera)
    time.sleep(1)
    camera.reopen()
    frame = next(camera)
    elapsed = round((frame.stamp_ns - first.stamp_ns) / PERIOD_NS)
    assert camera.device.bus_info == "platform:vivid-000"
    assert frame.sequence - first.sequence == pytest.approx(elapsed, abs=1)
    assert frame.dropped >= 20


def test_a_driver_that_gives_up_is_a_lost_camera(camera: V4L2Camera) -> None:
    next(camera)
    control("inject_fatal_streaming_error=1")
    with pytest.raises(CameraLost):
        list(islice(camera, 8))
    camera.reopen()
    assert next(camera).image.any()


def test_size_rate_and_format_are_negotiated_or_refused() -> None:
    with V4L2Camera(
        "/dev/video1", "camera", size=(320, 180), rate_hz=30, pixel_format="YUYV"
    ) as camera:
        assert next(camera).image.shape == (180, 320, 3)
        assert camera.nominal_rate_hz == pytest.approx(30)
    with pytest.raises(DeviceError, match="gives only 320x180 YUYV"):
        V4L2Camera("/dev/video1", "camera", size=(333, 222), pixel_format="YUYV")
    with pytest.raises(DeviceError, match="gives only"):
        V4L2Camera("/dev/video1", "camera", pixel_format="MJPG")


def test_a_camera_is_found_by_number_path_and_place(camera: V4L2Camera) -> None:
    assert [device.card for device in list_cameras()] == ["vivid", "vivid"]
    for spec in ("1", "/dev/video1", "v4l2:platform:vivid-001"):
        with open_camera_source(spec, "rear") as source:
            assert isinstance(source, V4L2Camera)
            assert source.live
            assert str(source.device.path) == "/dev/video1"
    with pytest.raises(DeviceError, match="2 cameras have this name; choose one of v4l2:platform"):
        open_camera_source("v4l2:vivid", "rear")


def test_a_busy_camera_is_refused_in_one_line(
    camera: V4L2Camera, capfd: pytest.CaptureFixture[str]
) -> None:
    next(camera)
    with pytest.raises(DeviceError, match="/dev/video0: is busy"):
        V4L2Camera("0", "other")
    assert capfd.readouterr().err == ""
    assert next(camera).image.any()


def test_closing_ends_a_reader_in_another_thread(camera: V4L2Camera) -> None:
    next(camera)
    control("percentage_of_dropped_buffers=100")
    reader = Thread(target=lambda: list(camera))
    reader.start()
    camera.close()
    reader.join(timeout=30)
    assert not reader.is_alive()
    assert list(camera) == []
