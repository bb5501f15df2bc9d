"""Images and videos of a data set: their form is kept, and what cannot be read is named."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from node.dataset.plan import make_plan
from tests.node.datasets import murk, one_line, run_all


def test_an_image_keeps_its_form(tmp_path: Path) -> None:
    """Gray, transparency, and how EXIF data say that the picture is to be turned."""
    source, plain = tmp_path / "in", np.full((40, 60, 3), 128, np.uint8)
    source.mkdir()
    picture = PillowImage.fromarray(plain)
    exif = picture.getexif()
    exif[0x0112] = 6
    for name in ("turned.jpg", "turned.png"):
        picture.save(source / name, exif=exif, icc_profile=bytes(100_000))
    picture.convert("L").save(source / "gray.png")
    picture.convert("L").save(source / "gray.jpg")
    picture.putalpha(PillowImage.linear_gradient("L").resize(picture.size))
    picture.save(source / "through.png")
    run_all(make_plan(source, tmp_path / "out", ["noise"], [10], 1))
    for path in source.iterdir():
        with (
            PillowImage.open(path) as before,
            PillowImage.open(tmp_path / "out" / path.name) as after,
        ):
            assert (after.mode, after.size) == (before.mode, before.size)
            assert after.getexif().get(0x0112) == before.getexif().get(0x0112)
            noise = np.asarray(after, float)[..., :3] - np.asarray(before, float)[..., :3]
            assert np.std(noise) == pytest.approx(10, rel=0.1)
            if after.mode == "RGBA":
                np.testing.assert_array_equal(np.asarray(after)[..., 3], np.asarray(before)[..., 3])


def test_an_image_of_16_bits_is_refused(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "deep.png"), np.zeros((9, 16, 3), np.uint16))
    result = murk(tmp_path / "deep.png", tmp_path / "out", "--kind=blur", "--level=0")
    assert "uint16" in one_line(result)


def test_a_video_that_is_cut_off_is_named_with_what_is_missing(small: Path, tmp_path: Path) -> None:
    """Its header stands before its frames, the last of which is cut in half."""
    path, sizes = tmp_path / "cut.mp4", []
    with (
        av.open(str(small / "drive.mp4")) as whole,
        av.open(str(path), "w", options={"movflags": "faststart"}) as copy,
    ):
        stream = copy.add_stream_from_template(whole.streams.video[0])
        for packet in whole.demux(video=0):
            if packet.size:
                sizes.append(packet.size)
                packet.stream = stream
                copy.mux(packet)
    path.write_bytes(path.read_bytes()[: -sizes[-1] // 2])
    line = one_line(murk(path, tmp_path / "out", "--kind=blur", "--level=10"))
    assert "of its 4 frames 1 are damaged or missing" in line
