"""Recordings as input: replayed, estimated, decoded, degraded."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from dbc.errors import InputError, SceneError
from drivers.candump import write_candump
from drivers.encode import encode_scan
from models.estimate.calibration import Calibration
from models.estimate.level import NoiseLevel
from node.batch import estimate_paths
from node.bus.in_process import Bus
from node.bus.mcap_reader import open_mcap
from node.bus.messages import serialize, typestore
from node.cli.scene_flags import build_scene
from node.dataset.job import run_job
from node.dataset.labels import write_labels
from node.dataset.plan import begin, make_plan
from node.outputs import open_outputs
from node.pipeline import Pipeline
from node.plan import plan
from node.recording import RecordingSource, open_sensors, read_recording
from node.scene import Scene, Sensor, check_scene, read_scene_file
from tests.node.recordings import level, published, record, scan, scene_plan

MURK = [sys.executable, "-c", "from node.cli import main; main()"]
SCANS, IMAGES = 20, 8
FAST = {"fast": True}


@pytest.fixture(scope="module")
def sensors(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """Return a radar and a camera that were recorded as a CAN log and as images."""
    folder = tmp_path_factory.mktemp("sensors")
    (folder / "images").mkdir()
    rng = np.random.default_rng(0)
    for number in range(IMAGES):
        image = cv2.GaussianBlur(rng.integers(0, 256, (120, 160, 3), dtype=np.uint8), (0, 0), 1.5)
        cv2.imwrite(str(folder / "images" / f"{number:03}.png"), image)
    write_candump(folder / "radar.log", (encode_scan(scan(n)) for n in range(SCANS)))
    return [
        {"name": "front", "type": "radar", "source": str(folder / "radar.log")},
        {"name": "camera", "type": "camera", "source": str(folder / "images")},
    ]


def run(scene: Scene) -> list[NoiseLevel]:
    """Run a scene to its end with its outputs."""
    with Bus() as bus:
        pipeline = Pipeline(plan(scene), bus)
        with open_outputs(pipeline.plan, bus, pipeline.set_injection):
            return list(pipeline.run())


def comparable(levels: list[NoiseLevel]) -> list[dict[str, Any]]:
    """Return levels without their latency, which no two runs have in common."""
    names = [one.name for one in fields(NoiseLevel) if one.name != "latency_ns"]
    rows = [{name: getattr(level, name) for name in names} for level in levels]
    return [{**row, "probabilities": row["probabilities"].tolist()} for row in rows]


@pytest.fixture(scope="module")
def recorded(
    sensors: list[dict[str, Any]], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, list[NoiseLevel]]:
    """Return a recording of both sensors, degraded, and the levels that were estimated."""
    path = tmp_path_factory.mktemp("recorded") / "drive.mcap"
    content = {
        "name": "drive",
        "sensors": sensors,
        "clock": FAST,
        "injections": [
            {"sensor": "front", "kind": "snr", "points": [[0.5, 60]]},
            {"sensor": "camera", "kind": "blur", "level": 40},
        ],
        "outputs": {"record": {"path": path, "images": True}},
    }
    return path, run(check_scene(content, "test"))


def test_a_replay_gives_the_recorded_levels_to_the_bit_and_so_does_another(
    recorded: tuple[Path, list[NoiseLevel]],
) -> None:
    path, levels = recorded
    once, again = run(build_scene(path, fast=True)), run(build_scene(path, fast=True))
    assert len(levels) == SCANS + IMAGES
    assert comparable(once) == comparable(levels)
    assert comparable(again) == comparable(levels)
    assert {one.sensor: one.injected for one in once} == {
        "front": {"snr": 60.0},
        "camera": {"blur": 40.0},
    }


def test_a_sensor_that_was_calibrated_is_so_again(
    sensors: list[dict[str, Any]], tmp_path: Path
) -> None:
    path, file = tmp_path / "drive.mcap", tmp_path / "front.json"
    Calibration("radar", {"ghosts": (0.5, 3.0)}, 0.8, (0.1,) * 10 + (0.5,)).write(file)
    radar = {**sensors[0], "calibration": file}
    outputs = {"record": {"path": path}}
    content = {"sensors": [radar], "clock": FAST, "outputs": outputs}
    levels = run(check_scene(content, "test"))
    assert comparable(run(build_scene(path, fast=True))) == comparable(levels)
    file.unlink()
    with pytest.raises(InputError, match=r"front\.json"):
        run(build_scene(path, fast=True))


def test_a_camera_that_was_read_adaptively_is_so_again(
    sensors: list[dict[str, Any]], tmp_path: Path
) -> None:
    path = tmp_path / "drive.mcap"
    camera = {**sensors[1], "adaptive": True}
    outputs = {"record": {"path": path, "images": True}}
    content = {"sensors": [camera], "clock": {**FAST, "loop": True}, "outputs": outputs}
    levels = run(check_scene({**content, "duration_s": 4.0}, "test"))
    assert build_scene(path).sensors[0].adaptive
    assert comparable(run(build_scene(path, fast=True))) == comparable(levels)


def test_a_replay_keeps_the_order_of_the_run_in_json(
    recorded: tuple[Path, list[NoiseLevel]],
) -> None:
    path, levels = recorded
    command = [*MURK, "run", str(path), "--fast", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    rows = [{k: v for k, v in line.items() if k not in ("type", "latency_ns")} for line in lines]
    assert rows[: len(levels)] == json.loads(json.dumps(comparable(levels), default=asdict))
    assert lines[-1]["type"] == "summary"
    assert lines[-1]["scene"] == "drive"


def test_a_replay_is_degraded_further_shortened_and_looped(
    recorded: tuple[Path, list[NoiseLevel]],
) -> None:
    path, _ = recorded
    more = run(build_scene(path, fast=True, inject=["camera:noise:100"], duration=0.45))
    injected = [one.injected for one in more if one.sensor == "camera"]
    assert injected == [{"blur": 40.0, "noise": 100.0}] * 5
    assert 0 < sum(one.sensor == "front" for one in more) < SCANS
    looped = run(build_scene(path, fast=True, loop=True, duration=3.0))
    stamps = [one.stamp_ns for one in looped if one.sensor == "front"]
    assert len(stamps) > SCANS
    assert stamps == sorted(set(stamps))


def test_one_sensor_of_a_recording_is_a_source_in_a_scene_beside_it(
    recorded: tuple[Path, list[NoiseLevel]],
) -> None:
    path, levels = recorded
    scene = path.with_name("scene.toml")
    for source in ("drive.mcap", "drive.mcap:/murk/front/scan"):
        scene.write_text(f'[[sensors]]\nname = "other"\ntype = "radar"\nsource = "{source}"\n')
        content = read_scene_file(scene)
        got = run(check_scene({**content, "clock": FAST}, scene))
        expected = [one for one in levels if one.sensor == "front"]
        assert [one.level for one in got] == [one.level for one in expected]
        assert {one.sensor for one in got} == {"other"}
    assert [one.level for one in run(build_scene(None, radar=str(path), fast=True))] == [
        one.level for one in expected
    ]


def test_a_recording_is_estimated_and_decoded(recorded: tuple[Path, list[NoiseLevel]]) -> None:
    path, levels = recorded
    rows = list(estimate_paths([path]))
    assert len(rows) == len(levels)
    # A camera's frame is estimated by itself in a run too, a scan with those before it.
    raw = {one.sequence: one.raw for one in levels if one.sensor == "camera"}
    for row in rows:
        if row.source.endswith("image"):
            assert row.estimate.level == raw[row.sequence]
    assert {row.source for row in rows} == {
        f"{path}:/murk/front/scan",
        f"{path}:/murk/camera/image",
    }
    command = [*MURK, "decode", str(path), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert len(done.stdout.splitlines()) == SCANS


def test_the_parts_of_a_recording_replay_as_one(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    counts = record(scene_plan(path, record={"split_s": 1e-9}), published(4))
    assert counts["files"] > 2
    for sensor, source in open_sensors(path):
        assert [message.sequence for message in source.messages()] == [0, 1, 2, 3], sensor.name


def test_a_replay_of_a_radar_loads_nothing_for_cameras(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    messages = [one for one in published(3) if one[0].startswith("/murk/front")]
    record(scene_plan(path), messages)
    made = plan(build_scene(path))
    assert set(made.libraries) == {"mcap", "onnxruntime", "rosbags"}
    program = (
        "import sys; from node.cli import app; app(sys.argv[1:], standalone_mode=False);"
        "sys.exit(bool({'cv2', 'av'} & set(sys.modules)))"
    )
    command = [sys.executable, "-c", program, "run", str(path), "--fast", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count('"noise_level"') == 3


def test_a_message_whose_level_was_not_recorded_is_replayed_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    scans = [scan(number) for number in range(3)]
    messages: list[tuple[str, Any]] = [("/murk/front/scan", one) for one in scans]
    record(
        scene_plan(path), [*messages, ("/murk/front/noise_level", level(scans[2], {"snr": 1.0}))]
    )
    ((_, source),) = open_sensors(path)
    assert [one.injected for one in source.messages()] == [None, None, {"snr": 1.0}]


def test_a_recording_is_degraded_topic_by_topic_and_labelled(tmp_path: Path) -> None:
    path, output = tmp_path / "drive.mcap", tmp_path / "output"
    record(scene_plan(path), published(4))
    made = make_plan(path, output, ["missed", "noise"], [0.0, 50.0], seed=3)
    done = {(one.job.kind, one.job.level): one for one in map(run_job, begin(made))}
    for (kind, level_), one in done.items():
        copy = output / one.job.target
        assert one.messages == 4
        if level_ == 0:
            assert copy.read_bytes() == path.read_bytes()
            continue
        changed = "front" if kind == "missed" else "camera"
        both = zip(open_sensors(path), open_sensors(copy), strict=True)
        for (sensor, before), (_, after) in both:
            pairs = list(zip(before.messages(), after.messages(), strict=True))
            assert all(a.stamp_ns == b.stamp_ns and a.sequence == b.sequence for a, b in pairs)
            assert {equal(a, b) for a, b in pairs} == {sensor.name != changed}
        topics = open_mcap(copy)
        stale = f"/murk/{changed}/noise_level"
        assert stale not in {entry.topic for entry in topics.entries()}
    assert begin(made) == []
    _, lines = write_labels(made)
    labels = [json.loads(line) for line in lines.read_text().splitlines()]
    for one in done.values():
        own = [label["sequence"] for label in labels if label["file"] == one.job.target]
        assert own == [0, 1, 2, 3]


def equal(a: Any, b: Any) -> bool:
    if hasattr(a, "image"):
        return bool(np.array_equal(a.image, b.image))
    return len(a) == len(b) and bool(np.array_equal(a.x, b.x))


def test_a_foreign_recording_is_degraded_in_its_own_types(foreign: Path, tmp_path: Path) -> None:
    made = make_plan(foreign, tmp_path / "output", ["over"], [60.0], seed=3)
    (done,) = map(run_job, begin(made))
    copy = tmp_path / "output" / done.job.target
    assert done.messages == 6
    assert open_mcap(copy).topics == open_mcap(foreign).topics
    for (_, before), (_, after) in zip(open_sensors(foreign), open_sensors(copy), strict=True):
        pairs = list(zip(before.messages(), after.messages(), strict=True))
        assert len(pairs) == 3
        assert all(b.image.mean() > a.image.mean() for a, b in pairs)


def image_message(store: Any, number: int, encoding: str) -> Any:
    types = store.types
    pixels = np.full((6, 8, 3), (10 * number, 20, 30), np.uint8)
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](5, number), "optic")
    if encoding == "jpeg":
        data = cv2.imencode(".jpg", pixels)[1].reshape(-1)
        return types["sensor_msgs/msg/CompressedImage"](header, "jpeg", data)
    if encoding == "rgb8":
        pixels = pixels[..., ::-1]
    data = np.ascontiguousarray(pixels).reshape(-1)
    return types["sensor_msgs/msg/Image"](header, 6, 8, encoding, 0, 24, data)


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """Return a recording of ROS 2 as rosbags writes it: two cameras and a lidar."""
    store = typestore()
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, encoding in (("/left/image_raw", "rgb8"), ("/right/image/compressed", "jpeg")):
            first = serialize(image_message(store, 0, encoding), store)
            connection = writer.add_connection(topic, first.type_name, typestore=store)
            for number in range(3):
                message = serialize(image_message(store, number, encoding), store)
                writer.write(connection, 1000 + number, message.cdr)
        writer.add_connection("/lidar", "sensor_msgs/msg/PointCloud2", typestore=store)
    (path,) = (tmp_path / "bag").glob("*.mcap")
    return path


def test_the_cameras_of_a_foreign_recording_are_sources(foreign: Path) -> None:
    content = read_recording(foreign)
    assert [(one["name"], one["type"]) for one in content["sensors"]] == [
        ("left_image_raw", "camera"),
        ("right_image_compressed", "camera"),
    ]
    for _, source in open_sensors(foreign):
        frames = list(source.messages())
        assert [one.stamp_ns for one in frames] == [5_000_000_000 + n for n in range(3)]
        assert [one.sequence for one in frames] == [0, 1, 2]
        for number, frame in enumerate(frames):
            assert np.abs(frame.image[3, 4].astype(int) - (10 * number, 20, 30)).max() <= 3


def test_a_topic_that_is_not_clear_is_asked_for(foreign: Path) -> None:
    def source(name: str, source: str) -> RecordingSource:
        return RecordingSource(Sensor(name=name, type="camera", source=source))

    with pytest.raises(SceneError, match=r"2 topics.*give one of .*:/left/image_raw, "):
        source("camera", str(foreign))
    with pytest.raises(SceneError, match="no topic /nothing"):
        source("camera", f"{foreign}:/nothing")
    assert source("left_image_raw", str(foreign))
    assert source("camera", f"{foreign}:/left/image_raw")
    with pytest.raises(InputError, match="holds no radar's data"):
        RecordingSource(Sensor(name="radar", type="radar", source=str(foreign)))


def bad_files(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield names of files that were just made, and what is wrong with them."""
    record(scene_plan(folder / "whole.mcap"), published(1))
    whole = (folder / "whole.mcap").read_bytes()
    levels = {"scans": False, "images": False}
    record(scene_plan(folder / "levels.mcap", record=levels), published(1))
    contents = {
        "empty": (b"", "is empty"),
        "binary": (bytes(range(256)) * 8, "is not MCAP"),
        "text": (b"[[sensors]]\nname = 'x'\n", "is not MCAP"),
        "begun": (whole[:20], "ends or is damaged at its beginning"),
        "headed": (whole[:1200], "holds no message"),
    }
    for name, (content, what) in contents.items():
        (folder / f"{name}.mcap").write_bytes(content)
        yield name, what
    yield "levels", "holds no sensor's data to replay"
    yield "missing", "no such file"


def test_bad_files_are_refused_in_one_line(tmp_path: Path) -> None:
    for name, what in bad_files(tmp_path):
        path = tmp_path / f"{name}.mcap"
        with pytest.raises(InputError) as raised:
            read_recording(path)
        assert str(raised.value).startswith(f"{path}: {what}"), name
        assert raised.value.remedy
        assert raised.value.exit_code == 2


@pytest.mark.parametrize("command", ["run", "estimate", "decode"])
def test_a_bad_file_ends_each_command_with_one_line_and_exit_code_2(
    tmp_path: Path, command: str
) -> None:
    path = tmp_path / "binary.mcap"
    path.write_bytes(bytes(range(256)))
    done = subprocess.run([*MURK, command, str(path)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        f"murk: {path}: is not MCAP; expected a recording of murk or ROS 2"
    ]
