from __future__ import annotations

import csv
import gzip
import hashlib
import itertools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from dbc.errors import InputError, MissingExtra, SceneError
from drivers.ars408_cycles import find_cycles
from drivers.can_frames import concatenate
from drivers.candump import read_candump, write_candump
from drivers.nuscenes import POINT, cloud_bytes, new_cloud, read_cloud
from drivers.video import open_video
from drivers.video_writer import VideoWriter
from models.degrade import camera, weather
from models.degrade.draw import DrawKey
from models.world.camera import WorldCamera
from models.world.radar import WorldRadar
from models.world.road import World
from node.dataset import workers
from node.dataset.job import run_job
from node.dataset.labels import write_labels
from node.dataset.plan import ALL_LEVELS, Plan, begin, make_plan
from node.dataset.sources import find_sources
from node.dataset.workers import do_jobs, local_workers

MURK = [sys.executable, "-c", "from node.cli import main; main()", "degrade"]


def write_clouds(folder: Path, scans: list[Any]) -> None:
    folder.mkdir(parents=True)
    for number, scan in enumerate(scans):
        points = np.zeros(len(scan), POINT)
        for name in ("id", "x", "y", "vx", "vy", "rcs", "dyn_prop", "pdh0", "invalid_state"):
            points[name] = getattr(scan, name)
        (folder / f"scan{number}.pcd").write_bytes(cloud_bytes(new_cloud(points)))


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with everything that is understood, and something that is not."""
    folder = tmp_path_factory.mktemp("small")
    world = World(2, 3.0)
    view = WorldCamera(world, width=160, height=90)
    images = [view.frame(number).image for number in range(4)]
    (folder / "day" / "left").mkdir(parents=True)
    cv2.imwrite(str(folder / "day" / "1.jpg"), images[0])
    cv2.imwrite(str(folder / "day" / "left" / "2.png"), images[1])
    with VideoWriter(folder / "drive.mp4", lossless=True) as writer:
        for number, image in enumerate(images):
            writer.write(image, 80_000_000 * number)
    radar = WorldRadar(world)
    write_candump(folder / "radar.log", itertools.islice(radar.frames(), 6))
    write_candump(folder / "zipped.log.gz", itertools.islice(radar.frames(), 3))
    write_clouds(folder / "clouds", [radar.scan(number) for number in range(3)])
    (folder / "README.txt").write_text("not a log")
    return folder


def run_all(plan: Plan) -> Plan:
    for job in begin(plan):
        run_job(job)
    write_labels(plan)
    return plan


def tree(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def digests(folder: Path) -> dict[str, str]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in paths
    }


def murk(*arguments: object, timeout: float = 120) -> subprocess.CompletedProcess[str]:
    command = [*MURK, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout)


def one_line(result: subprocess.CompletedProcess[str]) -> str:
    assert result.returncode == 2, result.stderr
    assert len(result.stderr.splitlines()) == 1, result.stderr
    return result.stderr


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


def test_in_nuscenes_a_folder_is_a_sensor_and_lidar_is_passed_over(tmp_path: Path) -> None:
    names = ["samples/CAM_FRONT/b.jpg", "samples/CAM_FRONT/a.jpg", "samples/RADAR_FRONT/a.pcd"]
    for name in [*names, "samples/LIDAR_TOP/a.pcd", "maps/city.png", "sweeps/RADAR_FRONT/c.pcd"]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    sources, _ = find_sources(tmp_path)
    assert [(source.target, source.sensor, source.sequence) for source in sources] == [
        ("samples/CAM_FRONT/a.jpg", "samples/CAM_FRONT", 0),
        ("samples/CAM_FRONT/b.jpg", "samples/CAM_FRONT", 1),
        ("samples/RADAR_FRONT/a.pcd", "samples/RADAR_FRONT", 0),
        ("sweeps/RADAR_FRONT/c.pcd", "sweeps/RADAR_FRONT", 0),
    ]


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
        if label["sensor"] == "samples/CAM_FRONT":
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


def kill_workers(process: subprocess.Popen[str]) -> None:
    for pid in workers_of(process):
        os.kill(pid, signal.SIGKILL)


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [pid for pid in map(int, children) if b"spawn_main" in command_of(pid)]


def command_of(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def interrupt(command: list[str], after: int, *, workers_only: bool) -> None:
    """Start a run, and kill it (or its workers) after so many files; no worker outlives it."""
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        for _ in range(after):
            process.stdout.readline()
        workers = workers_of(process)
        if workers_only:
            kill_workers(process)
        else:
            process.kill()
        _, errors = process.communicate(timeout=60)
    if workers_only:
        assert process.returncode == 1
        assert len(errors.splitlines()) == 1
        assert "a worker process died" in errors
    deadline = time.monotonic() + 60
    while any(b"spawn_main" in command_of(pid) for pid in workers):
        assert time.monotonic() < deadline, "a worker goes on without its parent"
        time.sleep(0.05)


def check_interrupted(
    source: Path,
    folder: Path,
    arguments: list[str],
    workers_only: tuple[bool, ...],
    timeout: float = 120,
) -> None:
    """Kill a run now and then; what it leaves is always whole, and in the end the same."""
    whole, parts = folder / "whole", folder / "parts"
    result = murk(source, whole, *arguments, "--json", timeout=timeout)
    assert result.returncode == 0
    files = json.loads(result.stdout.splitlines()[-1])["files"]
    expected = digests(whole)
    shutil.rmtree(whole)
    command = [*MURK, str(source), str(parts), *arguments, "--json"]
    chance = random.Random(7)
    for only in workers_only:
        interrupt(command, chance.randint(1, files // 4), workers_only=only)
        there = digests(parts)
        finished = {name for name in there if not name.startswith(".murk/unfinished")}
        assert finished - {".murk/settings.part"} < set(expected)
        assert all(there[name] == expected[name] for name in finished)
    result = murk(source, parts, *arguments, "--json", timeout=timeout)
    summary = json.loads(result.stdout.splitlines()[-1])
    assert summary["complete"]
    assert summary["skipped"] > 0
    assert digests(parts) == expected
    shutil.rmtree(parts)


def test_killed_three_times_and_resumed_equals_uninterrupted(small: Path, tmp_path: Path) -> None:
    levels = [f"--level={level}" for level in range(0, 101, 20)]
    check_interrupted(
        small, tmp_path, ["--kind", "fog", "--kind", "snr", *levels], (False, True, False)
    )


def test_real_data_killed_and_resumed(data: Path, tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    photos = sorted((data / "camera" / "test").glob("*/*.jpg"))[:4]
    for path in [*photos, data / "radar" / "nuscenes_mini" / "scene-0061.log"]:
        (source / path.name).write_bytes(path.read_bytes())
    levels = ["--level=30", "--level=100"]
    check_interrupted(source, tmp_path, ["--kind", "noise", "--kind", "snr", *levels], (False,))


@pytest.mark.skipif("MURK_WHOLE" not in os.environ, reason="half an hour; set MURK_WHOLE to run")
@pytest.mark.parametrize("part", ["radar/nuscenes_mini", "camera/test"])
def test_all_real_data_by_all_kinds_killed_and_resumed(
    data: Path, tmp_path: Path, part: str
) -> None:
    check_interrupted(data / part, tmp_path, ["--all"], (False, False, False), timeout=7200)


def heed_ctrl_c() -> None:
    """What a shell starts in the background ignores Ctrl-C, and so would its children."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_ctrl_c_ends_with_a_summary(small: Path, tmp_path: Path) -> None:
    command = [*MURK, str(small), str(tmp_path / "out"), "--all", "--json"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=heed_ctrl_c
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=120)
    summary = json.loads(output.splitlines()[-1])
    assert process.returncode != 0
    assert "Traceback" not in errors
    assert summary["type"] == "summary"
    assert not summary["complete"]
    assert summary["left"] > 0


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
    (source / "a.jpg").write_bytes(b"no image")
    (source / "b.log").write_text("(0000000000.000000) can0 123#00\nnonsense\n")
    (source / "c.jpg").write_bytes((small / "day" / "1.jpg").read_bytes())
    (source / "d.pcd").write_bytes(b"no cloud")
    (source / "e.mp4").write_bytes(b"no video")
    (source / "f.log").write_bytes((small / "radar.log").read_bytes())
    (source / "g.mcap").write_bytes(b"no recording")
    flags = ("--kind=blur", "--kind=snr", "--level=50", "--json")
    result = murk(source, tmp_path / "out", *flags)
    line = one_line(result)
    assert "a.jpg" in line
    assert "4 other files" in line
    *done, summary = map(json.loads, result.stdout.splitlines())
    assert {one["file"] for one in done} == {"blur_50/c.jpg", "snr_50/f.log"}
    assert (summary["complete"], summary["left"]) == (False, 6)
    for name in ("a.jpg", "b.log", "d.pcd", "e.mp4", "g.mcap"):
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


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtra, match="scale"), workers.dask_workers("tcp://127.0.0.1:1"):
        pass


def process(*arguments: object) -> subprocess.Popen[bytes]:
    quiet = subprocess.DEVNULL
    command = [sys.executable, "-m", *map(str, arguments)]
    return subprocess.Popen(command, stdout=quiet, stderr=quiet)


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_cluster_that_loses_a_worker_gives_the_same(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="needs the extra scale")
    view = WorldCamera(World(2, 3.0), width=640, height=360)
    (tmp_path / "in").mkdir()
    for number in range(2):
        cv2.imwrite(str(tmp_path / "in" / f"{number}.png"), view.frame(number).image)
    kinds, levels = ["noise", "motion"], [10.0 * n for n in range(1, 11)]
    address = tmp_path / "scheduler.json"
    local = ("--host", "127.0.0.1", "--scheduler-file", address, "--no-dashboard")
    worker = ("distributed.cli.dask_worker", "--scheduler-file", address, "--no-dashboard",
              "--nthreads", 1, "--no-nanny", "--local-directory", tmp_path)  # fmt: skip
    running = [process("distributed.cli.dask_scheduler", "--port", 0, *local)]
    try:
        wait_for(address.exists)
        running += [process(*worker), process(*worker)]
        flags = [f"--kind={kind}" for kind in kinds] + [f"--level={level}" for level in levels]
        tcp = json.loads(address.read_text())["address"]
        command = [*MURK, tmp_path / "in", tmp_path / "far", *flags, "--scheduler", tcp, "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
            assert run.stdout is not None
            for _ in range(5):
                run.stdout.readline()
            running[-1].kill()
            done = len(list((tmp_path / "far" / ".murk" / "labels").rglob("*.jsonl")))
            *_, last = run.stdout.read().splitlines()
    finally:
        for one in running:
            one.kill()
            one.wait()
    assert done < 2 * len(kinds) * len(levels)
    summary = json.loads(last)
    assert (summary["complete"], summary["files"]) == (True, 40)
    near = run_all(make_plan(tmp_path / "in", tmp_path / "near", kinds, levels, 1))
    assert tree(tmp_path / "far") == tree(near.output)


def test_no_scheduler_is_an_input_error(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="needs the extra scale")
    monkeypatch.setattr(workers, "CONNECT_S", 0.5)
    for address in ("tcp://127.0.0.1:1", "nonsense://x"):
        with pytest.raises(InputError, match=address), workers.dask_workers(address):
            pass


def depth_folder(folder: Path, name: str, depth: Any) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".npy":
        np.save(path, depth)
    else:
        cv2.imwrite(str(path), depth)
    return folder


@pytest.mark.parametrize("name", ["left/2.npy", "left/2.png"])
def test_weather_by_a_depth_map(small: Path, tmp_path: Path, name: str) -> None:
    """A wall at 100 m on the left, nothing known on the right, road at 5 m: Koschmieder."""
    metres = np.full((90, 160), 5.0, np.float32)
    metres[:, :50], metres[:, 110:] = 100.0, 0.0
    stored = metres if name.endswith(".npy") else (metres * 256).astype(np.uint16)
    depth = depth_folder(tmp_path / "depth", name, stored)
    source = tmp_path / "in"
    (source / "left").mkdir(parents=True)
    (source / "left" / "2.png").write_bytes((small / "day" / "left" / "2.png").read_bytes())
    result = murk(source, tmp_path / "out", "--kind=fog", "--kind=noise", "--level=50",
                  "--depth", depth, "--horizon=0.4")  # fmt: skip
    assert result.returncode == 0, result.stderr
    image = np.asarray(cv2.imread(str(source / "left" / "2.png")), np.uint8)
    drawn = weather.draw("fog", 50, DrawKey(1, "left/2.png", 0), horizon=0.4)
    label = json.loads((tmp_path / "out" / "labels.jsonl").read_text().splitlines()[0])
    assert label["drawn"]["horizon"] == 0.4
    written = cv2.imread(str(tmp_path / "out" / "fog_50" / "left" / "2.png"))
    np.testing.assert_array_equal(written, weather.apply(drawn, image, depth_m=metres))
    contrast = [np.std(written[:, part]) / np.std(image[:, part])
                for part in (np.s_[:50], np.s_[50:110], np.s_[110:])]  # fmt: skip
    assert contrast[0] < 0.1
    assert contrast[1] > 0.7
    assert contrast[2] < 0.01


@pytest.mark.parametrize(
    ("name", "depth", "expected"),
    [
        ("other.npy", np.ones((90, 160)), "no such depth map"),
        ("1.npy", np.ones((90, 100)), "as the image"),
        ("1.npy", np.ones((90, 160), complex), "is no depth"),
        ("1.png", np.ones((90, 160), np.uint8), "16 bits"),
    ],
)
def test_a_depth_map_that_does_not_fit_is_refused(
    small: Path, tmp_path: Path, name: str, depth: Any, expected: str
) -> None:
    folder = depth_folder(tmp_path / "depth", name, depth)
    with pytest.raises(InputError, match=expected):
        run_all(make_plan(small / "day" / "1.jpg", tmp_path / "out", ["rain"], [50], 1,
                          depth=folder))  # fmt: skip


def test_a_depth_map_that_is_no_array_or_of_a_video_is_refused(small: Path, tmp_path: Path) -> None:
    (tmp_path / "1.npy").write_bytes(b"nothing")
    for source, expected in (("day/1.jpg", "cannot be read"), ("drive.mp4", "single images")):
        with pytest.raises(InputError, match=expected):
            run_all(make_plan(small / source, tmp_path / "out", ["snow"], [50], 1, depth=tmp_path))
    with pytest.raises(InputError, match="horizon"):
        make_plan(small / "day", tmp_path / "out", ["fog"], [50], 1, horizon=2.0)
