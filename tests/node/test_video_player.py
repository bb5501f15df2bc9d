from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from drivers.camera import open_camera_source
from drivers.candump import write_candump
from drivers.encode import encode_motion
from drivers.video_writer import VideoWriter


def drive(folder: Path) -> tuple[Path, Path]:
    """Write one second of a log and of its video, 20 Hz each."""
    stamps = range(0, 1_000_000_000, 50_000_000)
    log, video = folder / "drive.log", folder / "drive.mp4"
    write_candump(log, (encode_motion(1.0, 0.0, stamp_ns=10**18 + stamp) for stamp in stamps))
    with VideoWriter(video, lossless=True) as writer:
        for number, stamp in enumerate(stamps):
            writer.write(np.full((32, 32, 3), 10 * number, np.uint8), stamp)
    return log, video


def test_the_video_is_shown_beside_the_log(tmp_path: Path) -> None:
    log, video = drive(tmp_path)
    out = tmp_path / "out.mp4"
    command = [sys.executable, "-c", "from node.cli import main; main()", "play", str(log)]
    flags = ["virtual:beside", "--start", "0.5", "--video", str(video), "--video-to", str(out)]
    done = subprocess.run(
        [*command, *flags, "--json"], capture_output=True, text=True, timeout=60, check=True
    )
    summary = json.loads(done.stdout)
    assert summary["frames"] == 20
    assert summary["video_frames"] + summary["video_skipped"] <= 10
    with open_camera_source(out, "video") as frames:
        values = [int(frame.image[0, 0, 0]) for frame in frames]
    assert len(values) == summary["video_frames"] > 0
    assert min(values) >= 95  # nothing from before the start


def test_a_video_without_a_place_to_go_is_refused(tmp_path: Path) -> None:
    log, video = drive(tmp_path)
    command = [sys.executable, "-c", "from node.cli import main; main()", "play", str(log)]
    done = subprocess.run(
        [*command, "virtual:a", "--video", str(video)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2
    assert "--video-to" in done.stderr
