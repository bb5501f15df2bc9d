from __future__ import annotations

import csv
import gzip
import json
import os
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from dbc.errors import InputError, SceneError
from drivers.ars408_cycles import find_cycles
from drivers.can_frames import concatenate
from drivers.candump import read_candump
from drivers.nuscenes import read_cloud
from drivers.video import open_video
from models.degrade import camera
from models.degrade.draw import DrawKey
from node.dataset.job import run_job
from node.dataset.labels import write_labels
from node.dataset.plan import ALL_LEVELS, alone_in, begin, make_plan
from node.dataset.sources import find_sources
from node.dataset.workers import do_jobs, local_workers
from tests.node.datasets import murk, one_line, run_all, tree


def test_every_file_of_a_folder_is_found(small: Path) -> None:
    sources, ignored = find_sources(small)
    assert [(source.target, source.form) for source in sources] == [
        ("clouds/scan0.pcd", "cloud"),
        ("clouds/scan1.pcd", "cloud"),
        ("clouds/scan2.pcd", "cloud"),
        ("day/1.jpg", "image"),
        ("day/left/2.png", "image"),
        ("drive.mp4", "video"),
        ("radar.log", "log"),
        ("zipped.log.gz", "log"),
    ]
    assert ignored == 1


def test_in_nuscenes_a_channel_is_a_sensor_and_lidar_is_passed_over(tmp_path: Path) -> None:
    names = ["samples/CAM_FRONT/b.jpg", "samples/CAM_FRONT/a.jpg", "samples/RADAR_FRONT/b.pcd"]
    names += ["sweeps/RADAR_FRONT/c.pcd", "sweeps/RADAR_FRONT/a.pcd"]
    for name in [*names, "samples/LIDAR_TOP/a.pcd", "maps/city.png"]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    sources, _ = find_sources(tmp_path)
    assert [(source.target, source.sensor, source.sequence) for source in sources] == [
        ("samples/CAM_FRONT/a.jpg", "CAM_FRONT", 0),
        ("samples/CAM_FRONT/b.jpg", "CAM_FRONT", 1),
        ("samples/RADAR_FRONT/b.pcd", "RADAR_FRONT", 1),
        ("sweeps/RADAR_FRONT/a.pcd", "RADAR_FRONT", 0),
        ("sweeps/RADAR_FRONT/c.pcd", "RADAR_FRONT", 2),
    ]


def test_elsewhere_a_folder_is_a_sensor_and_a_file_of_many_messages_is_one(tmp_path: Path) -> None:
    for name in ("10.jpg", "9.jpg", "9.pcd", "left/1.jpg", "left/drive.mp4", "radar.log"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    sources, _ = find_sources(tmp_path)
    assert {source.target: (source.sensor, source.sequence) for source in sources} == {
        "9.jpg": (tmp_path.name, 0),
        "10.jpg": (tmp_path.name, 1),
        "9.pcd": (tmp_path.name, 0),
        "left/1.jpg": ("left", 0),
        "left/drive.mp4": ("left/drive.mp4", 0),
        "radar.log": ("radar.log", 0),
    }


def test_a_name_that_is_no_text_is_refused(tmp_path: Path) -> None:
    Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff.jpg")).touch()
    with pytest.raises(InputError, match="not UTF-8"):
        find_sources(tmp_path)


def test_all_kinds_and_levels_of_the_sensors_that_are_there(small: Path, tmp_path: Path) -> None:
    plan = make_plan(small, tmp_path / "out", [], ALL_LEVELS, 1)
    assert len(plan.jobs) == 11 * (16 * 3 + 10 * 5)
    radar = make_plan(small / "radar.log", tmp_path / "out", [], ALL_LEVELS, 1)
    assert len(radar.jobs) == 11 * 10
    assert radar.jobs[-1].target == "misalignment_100/radar.log"


def test_level_0_is_the_original(small: Path, tmp_path: Path) -> None:
    run_all(make_plan(small, tmp_path / "out", ["noise", "snr"], [0], 1))
    original, copy = tree(small), tree(tmp_path / "out")
    for name in ("day/1.jpg", "day/left/2.png"):
        assert copy[f"noise_0/{name}"] == original[name]
    for name in ("radar.log", "clouds/scan1.pcd"):
        assert copy[f"snr_0/{name}"] == original[name]
    unzipped = gzip.decompress(copy["snr_0/zipped.log.gz"])
    assert unzipped == gzip.decompress(original["zipped.log.gz"])
    with (
        open_video(small / "drive.mp4", "a") as before,
        open_video(tmp_path / "out" / "noise_0" / "drive.mp4", "a") as after,
    ):
        frames, copies = list(before), list(after)
    assert [frame.stamp_ns for frame in copies] == [frame.stamp_ns for frame in frames]
    for frame, again in zip(frames, copies, strict=True):
        np.testing.assert_array_equal(frame.image, again.image)


def test_a_label_is_enough_to_do_it_again(small: Path, tmp_path: Path) -> None:
    plan = run_all(make_plan(small, tmp_path / "out", ["noise"], [70], 5))
    lines = (plan.output / "labels.jsonl").read_text().splitlines()
    rows = {row["file"]: row for row in map(json.loads, lines)}
    row = rows["day/left/2.png"]
    assert (row["kind"], row["level"], row["seed"], row["sequence"]) == ("noise", 70, 5, 0)
    assert row["drawn"]["std"] == pytest.approx(70)
    drawn = camera.draw(row["kind"], row["level"], DrawKey(row["seed"], row["sensor"], 0))
    assert camera.Noise(**row["drawn"]) == drawn
    image = np.asarray(cv2.imread(str(small / "day" / "left" / "2.png")), np.uint8)
    written = cv2.imread(str(plan.output / row["file"]))
    np.testing.assert_array_equal(written, camera.apply(drawn, image))


def test_the_table_says_what_the_lines_say(small: Path, tmp_path: Path) -> None:
    plan = run_all(make_plan(small, tmp_path / "out", ["snr", "dirt"], [50, 100], 1))
    lines = list(map(json.loads, (plan.output / "labels.jsonl").read_text().splitlines()))
    with (plan.output / "labels.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(lines) == 2 * (4 + 2 + 6 + 3 + 3)
    for row, line in zip(rows, lines, strict=True):
        assert json.loads(row["drawn"]) == line["drawn"]
        assert [row["file"], row["sensor"]] == [line["file"], line["sensor"]]
        assert float(row["level"]) == line["level"]
    assert {line["file"] for line in lines} == {job.target for job in plan.jobs}


def test_radar_files_lose_clusters_and_keep_everything_else(small: Path, tmp_path: Path) -> None:
    run_all(make_plan(small, tmp_path / "out", ["missed"], [100], 1))
    before = concatenate(list(read_candump(small / "radar.log")))
    after = concatenate(list(read_candump(tmp_path / "out" / "radar.log")))
    lists = (0x600, 0x701, 0x702)
    for frames, other in ((before, after), (after, before)):
        rest = frames.select(~np.isin(frames.can_id, lists))
        again = other.select(~np.isin(other.can_id, lists))
        assert rest.stamp_ns.tobytes() == again.stamp_ns.tobytes()
        assert rest.data.tobytes() == again.data.tobytes()
    sizes = [[len(cycle.scan) for cycle in find_cycles(frames)] for frames in (before, after)]
    assert len(sizes[0]) == len(sizes[1])
    assert sum(sizes[1]) < sum(sizes[0])
    cloud = read_cloud(tmp_path / "out" / "clouds" / "scan0.pcd")
    assert 0 < len(cloud) < len(read_cloud(small / "clouds" / "scan0.pcd"))


def test_every_kind_can_be_written_and_read_again(small: Path, tmp_path: Path) -> None:
    source = tmp_path / "in"
    for name in ("samples/CAM_FRONT", "samples/RADAR_FRONT"):
        (source / name).mkdir(parents=True)
    (source / "samples/CAM_FRONT/0.jpg").write_bytes((small / "day" / "1.jpg").read_bytes())
    for number in range(3):
        cloud = small / "clouds" / f"scan{number}.pcd"
        (source / "samples/RADAR_FRONT" / cloud.name).write_bytes(cloud.read_bytes())
    plan = run_all(make_plan(source, tmp_path / "out", [], [100], 1))
    labels = [json.loads(line) for line in (plan.output / "labels.jsonl").read_text().splitlines()]
    assert len(labels) == 16 + 10 * 3
    for label in labels:
        assert label["drawn"]["kind"] == label["kind"]
        path = plan.output / label["file"]
        if label["sensor"] == "CAM_FRONT":
            assert cv2.imread(str(path)) is not None
        else:
            points = read_cloud(path).points
            assert len(points) > 0
            assert all(np.isfinite(points[name]).all() for name in ("x", "vx_comp", "vy_comp"))
            assert (np.diff(points["id"]) == 1).all()
    changed = {label["kind"] for label in labels if (plan.output / label["file"]).read_bytes()
               != (source / label["file"].partition("/")[2]).read_bytes()}  # fmt: skip
    assert changed == {label["kind"] for label in labels}


def test_workers_and_order_change_no_byte(small: Path, tmp_path: Path) -> None:
    arguments: tuple[Any, ...] = (["noise", "rain", "snr"], [30, 100], 3)
    plan = run_all(make_plan(small, tmp_path / "one", *arguments))
    many = make_plan(small, tmp_path / "two", *arguments)
    jobs = begin(many)
    random.Random(0).shuffle(jobs)
    with local_workers(2) as executor:
        assert len(list(do_jobs(jobs, executor))) == len(plan.jobs)
    write_labels(many)
    assert tree(tmp_path / "two") == tree(tmp_path / "one")
    other = run_all(make_plan(small, tmp_path / "other", ["noise", "rain", "snr"], [30, 100], 4))
    assert tree(other.output)["noise_30/day/1.jpg"] != tree(plan.output)["noise_30/day/1.jpg"]


def test_what_is_done_is_not_done_again(small: Path, tmp_path: Path) -> None:
    plan = make_plan(small / "day", tmp_path / "out", ["blur"], [10, 20], 1)
    first, *_ = begin(plan)
    run_job(first)
    again = make_plan(small / "day", tmp_path / "out", ["blur"], [10, 20], 1)
    assert begin(again) == plan.jobs[1:]
    (plan.output / first.target).unlink()
    assert begin(again) == plan.jobs


@pytest.mark.parametrize("replaced", ["in/left/1.png", "depth/left/1.npy"])
def test_a_file_whose_source_was_replaced_is_done_again(
    small: Path, tmp_path: Path, replaced: str
) -> None:
    for name in ("1", "2"):
        image, depth = tmp_path / f"in/left/{name}.png", tmp_path / f"depth/left/{name}.npy"
        for path in (image, depth):
            path.parent.mkdir(parents=True, exist_ok=True)
        image.write_bytes((small / "day" / "left" / "2.png").read_bytes())
        np.save(depth, np.full((90, 160), 50.0, np.float32))

    def left() -> list[str]:
        plan = make_plan(tmp_path / "in", tmp_path / "out", ["fog"], [50], 1,
                         depth=tmp_path / "depth")  # fmt: skip
        return [job.target for job in begin(plan)]

    run_all(make_plan(tmp_path / "in", tmp_path / "out", ["fog"], [50], 1,
                      depth=tmp_path / "depth"))  # fmt: skip
    assert left() == []
    os.utime(tmp_path / replaced, ns=(1, 1))
    assert left() == ["left/1.png"]


def test_a_second_run_into_the_same_folder_is_refused(small: Path, tmp_path: Path) -> None:
    begin(make_plan(small / "day", tmp_path / "out", ["blur"], [10], 1))
    command = (small / "day", tmp_path / "out", "--kind=blur", "--level=10")
    with alone_in(tmp_path / "out"):
        assert "another run" in one_line(murk(*command))
    assert murk(*command).returncode == 0


def test_other_settings_into_a_half_done_folder_are_refused(small: Path, tmp_path: Path) -> None:
    begin(make_plan(small, tmp_path / "out", ["blur"], [10], 1))
    for kinds, levels, seed, name in (
        (["over"], [10], 1, "kinds"),
        (["blur"], [20], 1, "levels"),
        (["blur"], [10], 2, "seed"),
    ):
        with pytest.raises(InputError, match=f"a run with {name}"):
            make_plan(small, tmp_path / "out", kinds, levels, seed)
    with pytest.raises(InputError, match="a run with input"):
        make_plan(small / "day", tmp_path / "out", ["blur"], [10], 1)
    (tmp_path / "out" / ".murk" / "settings.json").write_text("{")
    with pytest.raises(InputError, match="not murk's"):
        make_plan(small, tmp_path / "out", ["blur"], [10], 1)


def test_the_input_is_never_overwritten(small: Path, tmp_path: Path) -> None:
    before = tree(small)
    image = small / "day" / "1.jpg"
    for source, output in (
        (small, small),
        (small, small / "out"),
        (image, image),
        (image, image.parent),
        (small / "day", small),
    ):
        with pytest.raises(InputError):
            make_plan(source, output, ["blur"], [10], 1)
    (tmp_path / "out").symlink_to(small / "day")
    with pytest.raises(InputError, match="in the input"):
        make_plan(small, tmp_path / "out", ["blur"], [10], 1)
    assert tree(small) == before


def test_two_files_that_would_become_one_are_refused(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for name in ("a.avi", "a.avi.mp4"):
        (tmp_path / "in" / name).touch()
    with pytest.raises(InputError, match="target of another"):
        make_plan(tmp_path / "in", tmp_path / "out", ["blur"], [10], 1)


def test_a_kind_that_no_file_can_have_is_refused(small: Path, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="no 'snr'; camera: blur"):
        make_plan(small / "day", tmp_path / "out", ["snr"], [10], 1)
    with pytest.raises(InputError, match="101"):
        make_plan(small / "day", tmp_path / "out", ["blur"], [101], 1)


def test_a_bad_file_is_named_and_the_others_are_done(small: Path, tmp_path: Path) -> None:
    source = tmp_path / "in"
    source.mkdir()
    (source / "z.jpg").write_bytes(b"no image")
    (source / "b.log").write_text("(0000000000.000000) can0 123#00\nnonsense\n")
    (source / "c.jpg").write_bytes((small / "day" / "1.jpg").read_bytes())
    (source / "d.pcd").write_bytes(b"no cloud")
    (source / "e.mp4").write_bytes(b"no video")
    (source / "f.log").write_bytes((small / "radar.log").read_bytes())
    (source / "g.mcap").write_bytes(b"no recording")
    flags = ("--kind=blur", "--kind=snr", "--level=50", "--json")
    result = murk(source, tmp_path / "out", *flags)
    line = one_line(result)
    assert "e.mp4" in line
    assert "(and 4 more: g.mcap, z.jpg, b.log, d.pcd)" in line
    *done, summary = map(json.loads, result.stdout.splitlines())
    assert {one["file"] for one in done} == {"blur_50/c.jpg", "snr_50/f.log"}
    assert (summary["complete"], summary["left"]) == (False, 6)
    rows = map(json.loads, (tmp_path / "out" / "labels.jsonl").read_text().splitlines())
    assert {row["file"] for row in rows} == {"blur_50/c.jpg", "snr_50/f.log"}
    for name in ("z.jpg", "b.log", "d.pcd", "e.mp4", "g.mcap"):
        (source / name).unlink()
    summary = json.loads(murk(source, tmp_path / "out", *flags).stdout)
    assert (summary["complete"], summary["files"], summary["skipped"]) == (True, 0, 2)


def test_a_scan_with_another_number_is_done_again(small: Path, tmp_path: Path) -> None:
    folder = tmp_path / "in" / "samples" / "RADAR_FRONT"
    folder.mkdir(parents=True)
    for number in (0, 2):
        (folder / f"{number}.pcd").write_bytes((small / "clouds" / "scan0.pcd").read_bytes())
    run_all(make_plan(tmp_path / "in", tmp_path / "out", ["deception"], [100], 1))
    (folder / "1.pcd").write_bytes((folder / "0.pcd").read_bytes())
    left = begin(make_plan(tmp_path / "in", tmp_path / "out", ["deception"], [100], 1))
    assert [job.source.path.name for job in left] == ["1.pcd", "2.pcd"]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], "INPUT and OUTPUT"),
        (["{small}", "{out}"], "--all"),
        (["{small}", "{out}", "--kind=blur"], "--all"),
        (["{small}", "{out}", "--all", "--level=3"], "--all"),
        (["{small}/absent", "{out}", "--all"], "no such"),
        (["{small}/README.md", "{out}", "--all"], "no such"),
        (["{small}", "{small}", "--all"], "in the input"),
        (["{small}", "{small}/README.txt", "--all"], "input"),
        (["{small}", "{out}", "--kind=blur", "--level=300"], "300"),
    ],
)
def test_wrong_use_is_one_line(
    small: Path, tmp_path: Path, arguments: list[str], expected: str
) -> None:
    filled = [argument.format(small=small, out=tmp_path / "out") for argument in arguments]
    result = murk(*filled)
    assert expected in one_line(result)
    assert result.stdout == ""


def test_a_log_needs_no_video_library(small: Path, tmp_path: Path) -> None:
    script = (
        "import sys; from node.dataset.plan import *; from node.dataset.job import run_job\n"
        "from pathlib import Path\n"
        "plan = make_plan(Path(sys.argv[1]), Path(sys.argv[2]), ['snr'], [50.0], 1)\n"
        "[run_job(job) for job in begin(plan)]\n"
        "sys.stdout.write(' '.join(name for name in ('cv2', 'av') if name in sys.modules))"
    )
    command = [sys.executable, "-c", script, str(small / "radar.log"), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == ""
