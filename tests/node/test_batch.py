from __future__ import annotations

import json
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from dbc.errors import InputError
from drivers.ars408_cycles import find_cycles
from drivers.can_frames import concatenate
from drivers.candump import read_candump, write_candump
from drivers.video import open_video
from models.world.radar import WorldRadar
from models.world.road import World
from node.batch import Row, estimate_paths
from tests.node.datasets import digests

ESTIMATE = [sys.executable, "-c", "from node.cli import main; main()", "estimate"]


def answers(rows: list[Row]) -> list[tuple[str, int, float]]:
    return [(row.source, row.sequence, row.estimate.level) for row in rows]


def test_a_folder_gives_what_its_files_give(small: Path) -> None:
    rows = list(estimate_paths([small]))
    alone = [small / "day" / "1.jpg", small / "day" / "left" / "2.png", small / "drive.mp4",
             small / "radar.log", *sorted((small / "clouds").iterdir()),
             small / "zipped.log.gz"]  # fmt: skip
    expected = {(source, level) for source, _, level in answers(list(estimate_paths(alone)))}
    assert {(source, level) for source, _, level in answers(rows)} == expected
    assert {row.source for row in rows} == {str(path) for path in alone}


def test_single_files_are_counted_in_their_folder_in_natural_order(
    small: Path, tmp_path: Path
) -> None:
    photo = (small / "day" / "1.jpg").read_bytes()
    for name in ("10.jpg", "2.jpg", "1.jpg"):
        (tmp_path / name).write_bytes(photo)
    rows = list(estimate_paths([tmp_path]))
    assert [(Path(row.source).name, row.sequence) for row in rows] == [
        ("1.jpg", 0),
        ("2.jpg", 1),
        ("10.jpg", 2),
    ]
    assert {row.group for row in rows} == {str(tmp_path)}


def test_paths_are_named_as_they_were_given(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(small)
    before = digests(small)
    assert {row.source for row in estimate_paths([Path("day")])} == {"day/1.jpg", "day/left/2.png"}
    assert digests(small) == before


def test_what_cannot_be_read_is_said_at_the_end_and_costs_nothing_else(
    small: Path, tmp_path: Path
) -> None:
    (tmp_path / "0.png").write_bytes(b"no image")
    (tmp_path / "1.jpg").write_bytes((small / "day" / "1.jpg").read_bytes())
    (tmp_path / "2.pcd").write_bytes(b"no cloud")
    (tmp_path / "3.log").write_text("no log\n")
    (tmp_path / "4.log").write_bytes((small / "radar.log").read_bytes())
    rows: list[Row] = []
    with pytest.raises(
        InputError, match=r"0\.png.*and 3 more: .*2\.pcd, .*3\.log:1, .*absent\.mp4"
    ):
        rows.extend(estimate_paths([tmp_path, tmp_path / "absent.mp4"]))
    assert [Path(row.source).name for row in rows] == ["1.jpg"] + ["4.log"] * 6
    shown = subprocess.run(
        [*ESTIMATE, "."], capture_output=True, text=True, timeout=120, cwd=tmp_path
    )
    assert shown.returncode == 2
    assert len(shown.stderr.splitlines()) == 1
    assert "4.log" in shown.stdout


def test_a_window_takes_in_the_scans_before(data: Path) -> None:
    log = data / "radar" / "nuscenes_mini" / "scene-0061.log"
    alone, follow = (list(estimate_paths([log], window=window)) for window in (False, True))
    assert len(follow) == len(alone) == len(list(find_cycles(concatenate(list(read_candump(log))))))
    assert follow[0].estimate.level == alone[0].estimate.level
    later = [row.estimate.level for row in follow[3:]]
    assert later != [row.estimate.level for row in alone[3:]]


def test_images_know_nothing_of_each_other_and_frames_of_a_video_do(
    small: Path, tmp_path: Path
) -> None:
    frames = [row.estimate for row in estimate_paths([small / "drive.mp4"])]
    with open_video(small / "drive.mp4", "camera") as source:
        for frame in source:
            cv2.imwrite(str(tmp_path / f"{frame.sequence}.png"), frame.image)
    images = [row.estimate for row in estimate_paths([tmp_path])]
    backwards = [
        next(estimate_paths([tmp_path / f"{n}.png"])).estimate for n in reversed(range(len(images)))
    ]
    assert len(frames) == len(images) > 1
    for one, other in zip(images, reversed(backwards), strict=True):
        assert np.array_equal(one.probabilities, other.probabilities)
    same = [
        np.array_equal(one.probabilities, other.probabilities)
        for one, other in zip(frames, images, strict=True)
    ]
    assert same[0]
    assert not any(same[1:])


def test_a_degraded_data_set_is_scored_by_its_labels(small: Path, tmp_path: Path) -> None:
    """The labels name the files as the rows do, below the folder."""
    image = cv2.imread(str(small / "day" / "1.jpg"))
    cv2.imwrite(str(tmp_path / "a.png"), cv2.resize(image, (640, 360)))
    degrade = [*ESTIMATE[:-1], "degrade", tmp_path / "a.png", tmp_path / "out"]
    flags = ["--kind=noise", "--level=0", "--level=60", "--level=100"]
    subprocess.run([*degrade, *flags], check=True, capture_output=True, timeout=120)
    labels = [
        json.loads(line) for line in (tmp_path / "out" / "labels.jsonl").read_text().splitlines()
    ]
    levels = {row.source: row.estimate.level for row in estimate_paths([tmp_path / "out"])}
    assert set(levels) == {str(tmp_path / "out" / label["file"]) for label in labels}
    for label in labels:
        assert levels[str(tmp_path / "out" / label["file"])] == pytest.approx(
            label["level"], abs=25
        )


def test_radars_in_one_log_have_windows_of_their_own(tmp_path: Path) -> None:
    world = World(seed=3, duration_s=0.6)
    radars = [
        concatenate(list(WorldRadar(world, sensor_id=sensor_id, x_m=x_m).frames()))
        for sensor_id, x_m in ((0, 3.0), (1, 0.0))
    ]
    both = concatenate(radars)
    both = both.select(np.argsort(both.stamp_ns, kind="stable"))
    logs = [tmp_path / name for name in ("0.log", "1.log", "both.log")]
    for log, frames in zip(logs, (*radars, both), strict=True):
        write_candump(log, [frames])
    alone = {
        row.sensor: row.estimate.level
        for log in logs[:2]
        for row in estimate_paths([log], window=True)
    }
    together = {row.sensor: row.estimate.level for row in estimate_paths([logs[2]], window=True)}
    assert together == alone
    assert set(alone) == {"radar_0", "radar_1"}


def test_a_video_that_is_cut_off_is_named_after_its_frames(small: Path, tmp_path: Path) -> None:
    whole = (small / "drive.mp4").read_bytes()
    frames = len(list(estimate_paths([small / "drive.mp4"])))
    start = whole.index(b"mdat")
    end = start - 4 + int.from_bytes(whole[start - 4 : start])
    half = (start + end) // 2
    damaged = whole[:half] + bytes(end - half) + whole[end:]
    (tmp_path / "cut.mp4").write_bytes(damaged)
    rows: list[Row] = []
    with pytest.raises(InputError, match=r"cut\.mp4: \d+ of its frames are damaged or missing"):
        rows.extend(estimate_paths([tmp_path / "cut.mp4"]))
    assert 0 < len(rows) < frames


def test_an_image_that_promises_too_much_costs_only_itself(small: Path, tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes((small / "day" / "1.jpg").read_bytes())
    png = bytearray(cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes())
    png[16:24] = struct.pack(">II", 50_000, 50_000)
    png[29:33] = struct.pack(">I", zlib.crc32(png[12:29]))
    (tmp_path / "b.png").write_bytes(png)
    rows: list[Row] = []
    with pytest.raises(InputError, match=r"b\.png: cannot be decoded"):
        rows.extend(estimate_paths([tmp_path]))
    assert [Path(row.source).name for row in rows] == ["a.jpg"]


def test_clouds_of_a_folder_are_a_window_with_the_stamps_of_their_names(
    small: Path, tmp_path: Path
) -> None:
    clouds = sorted((small / "clouds").iterdir())
    for number, cloud in enumerate((clouds * 4)[:4]):
        name = f"n015__RADAR_FRONT__{1533151603555991 + 75_000 * number}.pcd"
        (tmp_path / name).write_bytes(cloud.read_bytes())
    alone, follow = (list(estimate_paths([tmp_path], window=window)) for window in (False, True))
    assert [row.stamp_ns for row in follow] == [
        (1533151603555991 + 75_000 * number) * 1000 for number in range(4)
    ]
    assert follow[0].estimate.level == alone[0].estimate.level
    assert follow[-1].estimate.level != alone[-1].estimate.level
