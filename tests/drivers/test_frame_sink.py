from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest
from numpy.typing import NDArray

from dbc.errors import DeviceError, VideoError
from drivers.camera import open_camera_source
from drivers.frame_sink import LAST_FRAME_S, SinkGone, open_frame_sink

SIZE = (36, 64, 3)


def image(number: int) -> NDArray[np.uint8]:
    return np.full(SIZE, 20 + 10 * number, np.uint8)


@pytest.mark.parametrize("name", ["x.mp4", "x.mkv"])
def test_a_video_file_shows_each_frame_at_its_stamp(tmp_path: Path, name: str) -> None:
    stamps_ns = [5_000_000_000, 5_040_000_000, 5_240_000_000, 5_240_000_000, 5_280_000_000]
    with open_frame_sink(str(tmp_path / name), Event()) as sink:
        for number, stamp_ns in enumerate(stamps_ns):
            sink.write(image(number), stamp_ns)
    with open_camera_source(tmp_path / name, "camera") as source:
        frames = list(source)
    shown_ms = [frame.stamp_ns / 1e6 for frame in frames]
    np.testing.assert_allclose(shown_ms, [0, 40, 240, 240, 280], atol=1)
    assert abs(float(frames[2].image.mean()) - 40) < 5


def test_a_video_file_without_a_frame_is_none(tmp_path: Path) -> None:
    open_frame_sink(str(tmp_path / "x.mp4"), Event()).close()
    assert list(tmp_path.iterdir()) == []


def test_a_named_pipe_carries_the_bytes_of_each_frame_and_then_its_end(tmp_path: Path) -> None:
    path = tmp_path / "frames"
    sink = open_frame_sink(f"pipe:{path}", Event())
    got: list[bytes] = []
    reader = Thread(target=lambda: got.append(path.read_bytes()))
    reader.start()
    for number in range(3):
        sink.write(image(number), 0)
    sink.close()
    reader.join()
    assert got == [b"".join(image(number).tobytes() for number in range(3))]


def test_a_pipe_without_a_reader_is_given_up_at_the_stop(tmp_path: Path) -> None:
    stop = Event()
    sink = open_frame_sink(f"pipe:{tmp_path / 'frames'}", stop)
    writer = Thread(target=sink.write, args=(image(0), 0))
    writer.start()
    stop.set()
    writer.join(5)
    assert not writer.is_alive()
    sink.close()


def test_a_reader_that_goes_or_hangs_is_told(tmp_path: Path) -> None:
    path, stop = tmp_path / "frames", Event()
    large = np.zeros((600, 800, 3), np.uint8)
    os.mkfifo(path)
    with open_frame_sink(f"pipe:{path}", stop) as sink:
        reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        stop.set()
        began_s = time.monotonic()
        with pytest.raises(SinkGone, match="does not take the last frame"):
            sink.write(large, 0)
        assert time.monotonic() - began_s >= LAST_FRAME_S
        os.close(reader)
        with pytest.raises(SinkGone, match="the reader has gone"):
            sink.write(large, 0)


def test_standard_output_carries_frames() -> None:
    code = (
        "import numpy, threading\n"
        "from drivers.frame_sink import open_frame_sink\n"
        "with open_frame_sink('-', threading.Event()) as sink:\n"
        "    for k in range(3): sink.write(numpy.full((600, 800, 3), k, numpy.uint8), 0)\n"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert result.stdout == b"".join(bytes([k]) * 600 * 800 * 3 for k in range(3))


@pytest.mark.parametrize("spec", ["x.avi", "frames", "can0", "nowhere/x.mp4", "pipe:nowhere/x"])
def test_what_is_no_output_is_told(
    spec: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(VideoError):
        open_frame_sink(spec, Event())
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_place_of_a_pipe_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("precious")
    with pytest.raises(VideoError, match="no pipe"):
        open_frame_sink(f"pipe:{tmp_path / 'x'}", Event())
    assert (tmp_path / "x").read_text() == "precious"


@pytest.mark.parametrize(
    ("path", "what"), [("/dev/video99", "no such file"), ("/dev/null", "is not a V4L2 device")]
)
def test_what_is_no_output_device_is_told(path: str, what: str) -> None:
    with pytest.raises(DeviceError, match=what):
        open_frame_sink(path, Event())


def test_a_change_of_size_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "frames"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    with open_frame_sink(f"pipe:{path}", Event()) as sink:
        sink.write(image(0), 0)
        with pytest.raises(VideoError, match="size changes"):
            sink.write(image(0)[:10], 0)
    os.close(reader)
