from __future__ import annotations

import os
import subprocess
import sys
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from threading import Thread

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from dbc.errors import VideoError
from drivers.camera import open_camera_source
from drivers.images import ImageFolder
from drivers.video import VideoFile, open_video

CLIPS = Path("camera", "clips")


def picture(index: int, height: int = 64, width: int = 96) -> NDArray[np.uint8]:
    """A smooth picture whose mean brightness tells its index."""
    ramp = np.linspace(0, 40, width, dtype=np.float64)
    image = np.broadcast_to(ramp[None, :, None] + 8 * index, (height, width, 3))
    return image.astype(np.uint8)


def encode(
    path: Path,
    pts: list[int],
    time_base: Fraction = Fraction(1, 90_000),
    size: tuple[int, int] = (64, 96),
    options: dict[str, str] | None = None,
    codec: str = "libx264",
) -> Path:
    with av.open(str(path), "w") as output:
        stream = output.add_stream(codec, rate=25, options=options or {})
        stream.height, stream.width = size
        stream.pix_fmt = "yuv420p"
        stream.codec_context.time_base = time_base
        for index, stamp in enumerate(pts):
            frame = av.VideoFrame.from_ndarray(picture(index % 16, *size), format="bgr24")
            frame.pts, frame.time_base = stamp, time_base
            output.mux(stream.encode(frame))
        output.mux(stream.encode(None))
    return path


def packets(path: Path) -> list[tuple[int, int, bool]]:
    """Place, size and key flag of each packet of a file."""
    with av.open(str(path)) as container:
        found = [(p.pos, p.size, p.is_keyframe) for p in container.demux(video=0) if p.size]
    return [(pos, size, key) for pos, size, key in found if pos is not None]


def test_frames_come_in_order_with_the_exact_stamps_of_an_irregular_file(tmp_path: Path) -> None:
    pts = [9_000, 12_001, 15_003, 19_999, 20_000, 90_000, 90_007, 333_333]
    path = encode(tmp_path / "a.mp4", pts, options={"bf": "2"})
    with open_video(path, "front") as video:
        frames = list(video)
    exact = [round(Fraction(stamp, 90_000) * 10**9) for stamp in pts]
    assert [frame.stamp_ns for frame in frames] == exact
    assert [frame.sequence for frame in frames] == list(range(len(pts)))
    assert {(frame.sensor, frame.stamp_source, frame.dropped) for frame in frames} == {
        ("front", "file", 0)
    }
    for index, frame in enumerate(frames):
        assert frame.image.dtype == np.uint8
        assert frame.image.flags["C_CONTIGUOUS"]
        assert np.abs(frame.image.astype(int) - picture(index).astype(int)).mean() < 4


def test_colours_come_as_blue_green_red(tmp_path: Path) -> None:
    path = tmp_path / "red.mp4"
    with av.open(str(path), "w") as output:
        stream = output.add_stream("libx264", rate=25)
        stream.height, stream.width, stream.pix_fmt = 64, 64, "yuv444p"
        red = np.zeros((64, 64, 3), dtype=np.uint8)
        red[..., 0] = 255
        output.mux(stream.encode(av.VideoFrame.from_ndarray(red, format="rgb24")))
        output.mux(stream.encode(None))
    with open_video(path, "camera") as video:
        blue, green, red_mean = next(video).image.reshape(-1, 3).mean(axis=0)
    assert red_mean > 245
    assert blue < 10
    assert green < 10


def test_earlier_frames_stay_as_they_were_when_later_ones_are_read(tmp_path: Path) -> None:
    path = encode(tmp_path / "a.mp4", [0, 3600, 7200])
    with open_video(path, "camera") as video:
        first = next(video).image
        copy = first.copy()
        list(video)
    assert np.array_equal(first, copy)


def test_a_bare_stream_without_stamps_is_timed_by_its_rate(tmp_path: Path) -> None:
    path = encode(tmp_path / "a.h264", [0, 3600, 7200], options={"bf": "0"})
    with open_video(path, "camera") as video:
        assert [frame.stamp_ns for frame in video] == [0, 40_000_000, 80_000_000]


def test_a_video_that_changes_size_goes_on(tmp_path: Path) -> None:
    small = encode(tmp_path / "a.h264", [0, 3600, 7200], size=(64, 96))
    large = encode(tmp_path / "b.h264", [0, 3600], size=(90, 128))
    both = tmp_path / "both.h264"
    both.write_bytes(small.read_bytes() + large.read_bytes())
    with open_video(both, "camera") as video:
        frames = list(video)
    assert [frame.image.shape for frame in frames] == [(64, 96, 3)] * 3 + [(90, 128, 3)] * 2
    assert np.abs(frames[4].image.astype(int) - picture(1, 90, 128).astype(int)).mean() < 4


@pytest.mark.parametrize("broken", [[3], [3, 4, 7], [9], [11]])
def test_every_frame_that_does_not_come_out_is_counted(tmp_path: Path, broken: list[int]) -> None:
    """The decoder also withholds what was predicted from a broken frame, without an error."""
    path = encode(tmp_path / "a.mp4", [3600 * i for i in range(12)], options={"g": "5", "bf": "0"})
    content = bytearray(path.read_bytes())
    for index, (pos, size, _) in enumerate(packets(path)):
        if index in broken:
            content[pos : pos + size] = bytes(size)
    path.write_bytes(content)
    with open_video(path, "camera") as video:
        frames = list(video)
        assert video.dropped > 0
        assert len(frames) + video.dropped == 12
    for frame in frames:
        assert frame.stamp_ns == frame.sequence * 40_000_000
        assert frame.sequence not in broken
        assert frame.sequence >= frame.dropped


def test_a_truncated_video_yields_what_it_has_and_ends(tmp_path: Path) -> None:
    path = encode(
        tmp_path / "a.mp4",
        [3600 * i for i in range(12)],
        options={"bf": "0"},
    )
    whole = packets(path)
    moov_first = tmp_path / "b.mkv"
    with av.open(str(path)) as source, av.open(str(moov_first), "w") as output:
        stream = output.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                output.mux(packet)
    content = moov_first.read_bytes()
    cut = packets(moov_first)[8]
    moov_first.write_bytes(content[: cut[0] + cut[1] // 2])
    with open_video(moov_first, "camera") as video:
        frames = list(video)
    assert len(whole) == 12
    assert [frame.sequence for frame in frames] == list(range(8))


def test_a_file_of_which_nothing_decodes_is_refused(tmp_path: Path) -> None:
    path = encode(tmp_path / "a.mp4", [0, 3600])
    content = bytearray(path.read_bytes())
    for pos, size, _ in packets(path):
        content[pos : pos + size] = bytes(size)
    path.write_bytes(content)
    with pytest.raises(VideoError, match="not one picture"):
        open_video(path, "camera")


def not_a_video(kind: str, folder: Path) -> Path:
    path = folder / "input.mp4"
    if kind == "empty":
        path.touch()
    elif kind == "random bytes":
        path.write_bytes(np.random.default_rng(0).bytes(20_000))
    elif kind == "text":
        path = folder / "input.txt"
        path.write_text("a text that a terminal could show\n" * 50)
    elif kind == "candump log":
        path = folder / "input.log"
        path.write_text("(1.000000) can0 600#0A00000000000000\n" * 50)
    elif kind == "sound":
        path = folder / "sound.wav"
        with av.open(str(path), "w") as output:
            stream = output.add_stream("pcm_s16le", rate=8000)
            sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), layout="mono")
            sound.sample_rate = 8000
            output.mux(stream.encode(sound))
    elif kind == "cut header":
        path = encode(path, [0, 3600, 7200])
        path.write_bytes(path.read_bytes()[:900])
    elif kind == "folder":
        path.mkdir()
    return path


@pytest.mark.parametrize(
    "kind",
    [
        *("missing", "empty", "random bytes", "text", "candump log"),
        *("sound", "cut header", "folder"),
    ],
)
def test_what_is_not_a_video_is_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    path = not_a_video(kind, tmp_path)
    with pytest.raises(VideoError) as caught:
        open_video(path, "camera")
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read every file")
def test_a_file_without_permission_is_refused(tmp_path: Path) -> None:
    path = encode(tmp_path / "a.mp4", [0, 3600])
    path.chmod(0)
    with pytest.raises(VideoError, match="permission"):
        open_video(path, "camera")


def test_a_name_with_a_colon_is_a_file_and_not_a_protocol(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    encode(tmp_path / "a.mp4", [0]).rename("cam:1.mp4")
    with open_video(Path("cam:1.mp4"), "camera") as video:
        assert len(list(video)) == 1


def test_reading_after_close_ends_and_closing_twice_does_nothing(tmp_path: Path) -> None:
    video = open_video(encode(tmp_path / "a.mp4", [0, 3600, 7200]), "camera")
    next(video)
    video.close()
    video.close()
    assert list(video) == []


def test_a_video_may_be_closed_while_another_thread_reads_it(tmp_path: Path) -> None:
    path = encode(tmp_path / "a.mp4", [3600 * i for i in range(400)], size=(240, 320))
    video = open_video(path, "camera")
    seen: list[int] = []
    reader = Thread(target=lambda: seen.extend(frame.sequence for frame in video))
    reader.start()
    video.close()
    reader.join(timeout=30)
    assert not reader.is_alive()
    assert seen == list(range(len(seen)))
    assert list(video) == []


def write_images(folder: Path, names: list[str]) -> None:
    for index, name in enumerate(names):
        cv2.imwrite(str(folder / name), picture(index, 20 + index, 30))


def test_images_come_in_natural_order_each_in_its_own_size(tmp_path: Path) -> None:
    names = ["1.png", "2.bmp", "10.tiff", "a9.JPG", "a10.webp"]
    write_images(tmp_path, names)
    (tmp_path / "notes.txt").write_text("no image")
    with ImageFolder(tmp_path, "rear", rate_hz=3) as folder:
        frames = list(folder)
    assert [frame.image.shape[0] for frame in frames] == [20, 21, 22, 23, 24]
    assert [frame.stamp_ns for frame in frames] == [
        0,
        333_333_333,
        666_666_667,
        10**9,
        1_333_333_333,
    ]
    assert {(frame.sensor, frame.stamp_source) for frame in frames} == {("rear", "file")}
    assert np.array_equal(frames[0].image, picture(0, 20, 30))


def test_an_unreadable_image_is_counted_and_keeps_its_place(tmp_path: Path) -> None:
    write_images(tmp_path, ["0.png", "1.png", "2.png", "3.png"])
    (tmp_path / "1.png").write_bytes(b"")
    (tmp_path / "2.png").write_bytes(b"\x89PNG but no more")
    with ImageFolder(tmp_path, "camera") as folder:
        frames = list(folder)
        assert folder.dropped == 2
    assert [(frame.sequence, frame.dropped) for frame in frames] == [(0, 0), (3, 2)]
    assert frames[1].stamp_ns == 300_000_000


def test_gray_and_transparent_images_come_as_three_channels(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), np.full((5, 6), 7, np.uint8))
    cv2.imwrite(str(tmp_path / "1.png"), np.full((5, 6, 4), 9, np.uint8))
    with ImageFolder(tmp_path, "camera") as folder:
        assert [frame.image.shape for frame in folder] == [(5, 6, 3)] * 2


def test_folders_without_a_usable_image_are_refused(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match="holds no image"):
        ImageFolder(tmp_path, "camera")
    (tmp_path / "0.png").write_bytes(b"nothing")
    with pytest.raises(VideoError, match="not one picture"):
        ImageFolder(tmp_path, "camera")
    with pytest.raises(VideoError, match="no such file"):
        ImageFolder(tmp_path / "1.png", "camera")


def test_the_source_is_chosen_by_what_its_name_is(tmp_path: Path) -> None:
    video = encode(tmp_path / "a.mp4", [0, 3600])
    write_images(tmp_path, ["0.png", "1.png"])
    for spec, count, kind in (
        (video, 2, VideoFile),
        (str(video), 2, VideoFile),
        (tmp_path, 2, ImageFolder),
        (tmp_path / "1.png", 1, ImageFolder),
    ):
        with open_camera_source(spec, "camera") as source:
            assert isinstance(source, kind)
            assert not source.live
            assert len(list(source)) == count
    with pytest.raises(VideoError, match="no such file"):
        open_camera_source(tmp_path / "missing.mp4", "camera")


def test_a_video_needs_no_opencv_and_an_image_no_pyav(tmp_path: Path) -> None:
    video = encode(tmp_path / "a.mp4", [0, 3600])
    write_images(tmp_path, ["0.png"])
    script = (
        "import sys\n"
        "from drivers.camera import open_camera_source\n"
        "assert not {'av', 'cv2'} & set(sys.modules)\n"
        "list(open_camera_source(sys.argv[1], 'camera'))\n"
        "sys.stdout.write(' '.join(sorted({'av', 'cv2'} & set(sys.modules))))\n"
    )
    for path, loaded in ((video, "av"), (tmp_path / "0.png", "cv2")):
        result = subprocess.run(
            [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True
        )
        assert result.stdout == loaded


@pytest.mark.parametrize(
    ("name", "count", "step_ns"),
    [
        ("day_highway_960x540_25fps.mp4", 221, 40_000_000),
        ("day_city_1242x374_10fps.mp4", None, 100_000_000),
    ],
)
def test_real_clips_decode_whole(data: Path, name: str, count: int | None, step_ns: int) -> None:
    with open_video(data / CLIPS / name, "camera") as video:
        frames = [(f.sequence, f.stamp_ns, f.dropped, f.image.std() > 5) for f in video]
    assert count in (None, len(frames))
    assert all(dropped == 0 and varied for _, _, dropped, varied in frames)
    assert {b[1] - a[1] for a, b in pairwise(frames)} == {step_ns}
