from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from dbc.errors import VideoError
from drivers.video import open_video
from drivers.video_writer import VideoWriter

STAMPS = [1_700_000_000_000_000_000 + step for step in (0, 33_333_000, 70_000_000, 4_000_000_000)]


def noise(index: int, height: int = 48, width: int = 64) -> np.ndarray:
    return np.random.default_rng(index).integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_lossless_frames_come_back_to_the_bit_with_their_stamps(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    with VideoWriter(path, lossless=True) as writer:
        for index, stamp in enumerate(STAMPS):
            writer.write(noise(index), stamp)
    with open_video(path, "camera") as video:
        frames = list(video)
    assert [frame.stamp_ns for frame in frames] == STAMPS
    for index, frame in enumerate(frames):
        assert np.array_equal(frame.image, noise(index))


def test_matroska_keeps_every_pixel_and_stamps_to_the_millisecond(tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    with VideoWriter(path, lossless=True) as writer:
        for index, stamp in enumerate(STAMPS):
            writer.write(noise(index), stamp)
    assert path.read_bytes()[:4] == bytes.fromhex("1A45DFA3")
    with open_video(path, "camera") as video:
        frames = list(video)
    assert [frame.stamp_ns for frame in frames] == [stamp // 10**6 * 10**6 for stamp in STAMPS]
    assert all(np.array_equal(frame.image, noise(k)) for k, frame in enumerate(frames))


@pytest.mark.parametrize("size", [(48, 64), (47, 63), (1, 1)])
def test_frames_of_any_size_come_back_alike(tmp_path: Path, size: tuple[int, int]) -> None:
    path = tmp_path / "a.mp4"
    image = np.full((*size, 3), (40, 120, 200), np.uint8)
    with VideoWriter(path) as writer:
        writer.write(image, 0)
        writer.write(image, 40_000_000)
    with open_video(path, "camera") as video:
        frames = list(video)
    assert [frame.stamp_ns for frame in frames] == [0, 40_000_000]
    assert np.abs(frames[1].image.astype(int) - image).max() <= 4


def test_the_file_appears_only_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    path.write_text("older")
    writer = VideoWriter(path)
    writer.write(noise(0), 0)
    assert path.read_text() == "older"
    writer.close()
    writer.close()
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mp4"]
    with open_video(path, "camera") as video:
        assert len(list(video)) == 1


def test_an_exception_leaves_the_older_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    path.write_text("older")

    def fail_after_one_frame() -> None:
        with VideoWriter(path) as writer:
            writer.write(noise(0), 0)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_after_one_frame()
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mp4"]
    assert path.read_text() == "older"


def test_what_cannot_be_written_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match="no such file"):
        VideoWriter(tmp_path / "missing" / "a.mp4")
    with pytest.raises(VideoError, match="no frame was written"):
        VideoWriter(tmp_path / "a.mp4").close()
    with VideoWriter(tmp_path / "b.mp4") as writer:
        writer.write(noise(0), 10**9)
        with pytest.raises(VideoError, match="expected 64x48"):
            writer.write(noise(0, 48, 66), 2 * 10**9)
        with pytest.raises(VideoError, match="not after"):
            writer.write(noise(1), 10**9)
    assert [entry.name for entry in tmp_path.iterdir()] == ["b.mp4"]


@pytest.mark.skipif(not os.access("/dev/full", os.W_OK), reason="no /dev/full here")
def test_a_full_disk_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / ".a.mp4.part").symlink_to("/dev/full")
    writer = VideoWriter(tmp_path / "a.mp4", lossless=True)

    def write_much() -> None:
        for index in range(40):
            writer.write(noise(index, 256, 256), index * 10**7)
        writer.close()

    with pytest.raises(VideoError, match="no space left"):
        write_much()
    writer.discard()
    assert list(tmp_path.iterdir()) == []
