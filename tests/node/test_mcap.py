from __future__ import annotations

import json
import os
import resource
import shlex
import shutil
import signal
import struct
import subprocess
import sys
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from threading import Thread
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from rosbags.highlevel import AnyReader

from dbc.errors import InputError
from drivers.candump import write_candump
from drivers.encode import encode_scan
from drivers.scan import RadarScan
from models.estimate.level import NoiseLevel
from node.bus.in_process import Bus
from node.bus.inbox import Inbox
from node.bus.mcap import McapRecorder
from node.bus.mcap_reader import Entry, open_mcap
from node.events import EVENT_TOPIC, MODEL_TOPIC, ModelChoice, NodeEvent
from node.health import SensorEvent
from node.recording import decode, read_recording
from tests.node.recordings import START_NS, frame, level, published, record, scan, scene_plan

MURK = [sys.executable, "-c", "from node.cli import main; main()"]


def same(a: Any, b: Any) -> bool:
    """Compare two messages field by field, arrays and floats to the bit."""
    return type(a) is type(b) and all(
        np.array_equal(getattr(a, one.name), getattr(b, one.name), equal_nan=True)
        if isinstance(getattr(a, one.name), np.ndarray)
        else getattr(a, one.name) == getattr(b, one.name)
        for one in fields(a)
    )


def decoded(path: Path) -> list[Any]:
    """Return murk's messages of a file, in its order."""
    messages, info = [], {}
    for entry in open_mcap(path).entries():
        if entry.topic.endswith("_info"):
            info[entry.topic] = entry.cdr
        else:
            messages.append(decode(entry, info.get(f"{entry.topic}_info"), 0, path))
    return messages


def test_what_is_published_is_in_the_file_bit_for_bit_and_in_order(tmp_path: Path) -> None:
    others = [
        (EVENT_TOPIC, NodeEvent("can", START_NS, "the bus is down")),
        (MODEL_TOPIC, ModelChoice("detector", START_NS, "radar", "", "camera: 80 % ≥ 50 %")),
        ("/murk/front/event", SensorEvent("front", START_NS, "lost", "unplugged")),
    ]
    messages = [*published(6, {"snr": 60.0, "ghosts": 10.0}), *others]
    path = tmp_path / "drive.mcap"
    counts = record(scene_plan(path), messages)
    got = decoded(path)
    assert len(got) == len(messages)
    assert all(same(a, b) for a, (_, b) in zip(got, messages, strict=True))
    assert counts == {
        "path": str(path), "files": 1, "messages": len(messages) + 12, "dropped": 0, "failed": 0,
    }  # fmt: skip


@pytest.mark.parametrize(("images", "compression"), [(False, "zstd"), (True, "lz4")])
def test_times_sequences_index_and_profile_are_as_mcap_wants_them(
    tmp_path: Path, images: bool, compression: str
) -> None:
    path = tmp_path / "drive.mcap"
    record(scene_plan(path, record={"images": images}), published(4))
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert {chunk.compression for chunk in summary.chunk_indexes} == {compression}
        assert all(chunk.message_index_offsets for chunk in summary.chunk_indexes)
        assert summary.statistics is not None
        assert summary.statistics.message_count == 4 * (6 if images else 4)
        texts = {schema.name: schema.data.decode() for schema in summary.schemas.values()}
        assert "MSG: std_msgs/Header" in texts["murk_msgs/msg/NoiseLevel"]
        rows = [
            (message.log_time, message.publish_time, message.sequence)
            for _, channel, message in reader.iter_messages(topics="/murk/front/scan")
        ]
    assert [row[1:] for row in rows] == [(scan(n).stamp_ns, n) for n in range(4)]
    assert [row[0] for row in rows] == sorted(row[0] for row in rows)
    assert rows[0][0] > scan(3).stamp_ns  # wall time


def test_rosbags_reads_it_by_the_schemas_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(scene_plan(path), published(3, {"snr": 60.0}))
    with AnyReader([path]) as reader:
        qos = {one.topic: one.ext.offered_qos_profiles[0] for one in reader.connections}
        levels = [
            reader.deserialize(cdr, connection.msgtype)
            for connection, _, cdr in reader.messages()
            if connection.topic == "/murk/front/noise_level"
        ]
    assert [one.level for one in levels] == [level(scan(0)).level] * 3
    assert levels[0].injected_kinds == ["snr"]
    level_qos, scan_qos = qos["/murk/front/noise_level"], qos["/murk/front/scan"]
    assert (level_qos.reliability.name, level_qos.durability.name, level_qos.depth) == (
        "RELIABLE", "TRANSIENT_LOCAL", 1,
    )  # fmt: skip
    assert (scan_qos.reliability.name, scan_qos.durability.name, scan_qos.depth) == (
        "BEST_EFFORT", "VOLATILE", 5,
    )  # fmt: skip


def test_scans_and_images_are_left_out_where_the_scene_says_so(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(scene_plan(path, record={"scans": False, "images": False}), published(2))
    assert set(open_mcap(path).topics) == {
        "/murk/front/noise_level",
        "/murk/camera/noise_level",
    }


@pytest.mark.parametrize("split", [{"split_mb": 0.001}, {"split_s": 1e-9}], ids=["size", "time"])
def test_parts_hold_everything_once_and_each_can_be_read_alone(
    tmp_path: Path, split: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("node.bus.mcap.FLUSH_S", 0.0)
    path = tmp_path / "drive.mcap"
    messages = list(published(5))
    counts = record(scene_plan(path, record=split), messages)
    parts = [path, *sorted(tmp_path.glob("drive_*.mcap"), key=lambda one: int(one.stem[6:]))]
    assert counts["files"] == len(parts) > 2
    got = decoded(path)
    assert len(got) == len(messages)
    assert all(same(a, b) for a, (_, b) in zip(got, messages, strict=True))
    alone = []
    for part in parts:
        with part.open("rb") as file:
            alone += list(make_reader(file).iter_messages())
    assert len(alone) == counts["messages"]
    assert len(decoded(parts[2])) == len(messages) - sum(
        len(decoded_alone(part)) for part in parts[:2]
    )


def decoded_alone(path: Path) -> list[str]:
    with path.open("rb") as file:
        topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
    return [topic for topic in topics if not topic.endswith("_info")]


def test_a_stranger_named_as_a_part_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(scene_plan(path), published(2))
    record(scene_plan(tmp_path / "other.mcap"), published(3))
    (tmp_path / "other.mcap").rename(tmp_path / "drive_1.mcap")
    assert len(decoded(path)) == 8


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("taken.mcap", "exists, and is not overwritten"),
        ("part.mcap", "exists, and is not overwritten"),
        ("drive.bag", "is no name of an MCAP file"),
        ("nowhere/drive.mcap", "No such file or directory"),
        ("file/drive.mcap", "Not a directory"),
    ],
)
def test_a_bad_place_is_refused_in_one_line_and_nothing_is_lost(
    tmp_path: Path, name: str, what: str
) -> None:
    for other in ("taken.mcap", "part_1.mcap", "file"):
        (tmp_path / other).write_bytes(b"precious")
    with Bus() as bus, pytest.raises(InputError) as raised:
        McapRecorder(scene_plan(tmp_path / name), bus)
    assert what in str(raised.value)
    assert "\n" not in str(raised.value)
    assert (tmp_path / "taken.mcap").read_bytes() == b"precious"


def test_a_disk_that_is_full_from_the_start_is_refused_and_left_clean(tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        with Bus() as bus, pytest.raises(InputError, match="File too large"):
            McapRecorder(scene_plan(tmp_path / "drive.mcap"), bus)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())


def test_a_message_that_ros_cannot_say_is_counted_and_the_others_are_recorded(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "drive.mcap"
    messages = [(EVENT_TOPIC, object()), (EVENT_TOPIC, NodeEvent("can", START_NS, "up"))]
    counts = record(scene_plan(path), messages)
    assert (counts["messages"], counts["failed"]) == (1, 1)
    assert "is not recorded" in caplog.text


def test_a_queue_that_is_full_drops_its_topics_oldest_and_counts_it() -> None:
    with Bus() as bus:
        inbox = Inbox(bus, {"level": 3, "event": 3}, lossless=False)
        bus.publish("event", "first")
        for number in range(10):
            bus.publish("level", number)
        assert [one.message for one in inbox.take(0.0)] == ["first", 7, 8, 9]
        assert inbox.dropped == 7


def test_a_lossless_queue_loses_nothing_and_lets_everybody_go_when_it_closes() -> None:
    with Bus() as bus:
        inbox = Inbox(bus, {"level": 2}, lossless=True)
        publisher = Thread(target=lambda: [bus.publish("level", number) for number in range(50)])
        publisher.start()
        got: list[int] = []
        while len(got) < 40:
            got += [one.message for one in inbox.take(5.0)]
        inbox.close()
        publisher.join(5.0)
        assert not publisher.is_alive()
        got += [one.message for one in inbox.take(0.0)]
        assert got == list(range(len(got)))
        assert inbox.dropped == 0


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a CAN log of 300 scans of random clusters, hard to compress."""
    path = tmp_path_factory.mktemp("log") / "radar.log"
    write_candump(path, (encode_scan(scan(number, 250)) for number in range(300)))
    return path


def small_files() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))


def run_with_little_room(log: Path, folder: Path, how: str) -> subprocess.CompletedProcess[str]:
    arguments = ["run", "--radar", str(log), "--fast", "--json", "--record", "full/drive.mcap"]
    if how == "limit":
        return subprocess.run(
            [*MURK, *arguments], cwd=folder, capture_output=True, text=True, timeout=120,
            preexec_fn=small_files,
        )  # fmt: skip
    mount = "mount -t tmpfs -o size=1m murk full && cd . && "
    copy = "; status=$?; cp full/drive.mcap kept.mcap; exit $status"
    line = mount + shlex.join([*MURK, *arguments]) + copy
    return subprocess.run(
        ["unshare", "-rm", "sh", "-c", line], cwd=folder, capture_output=True, text=True,
        timeout=120,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("how", "why"), [("limit", "File too large"), ("disk", "No space left on device")]
)
def test_a_full_disk_ends_the_recording_and_not_the_node(
    log: Path, tmp_path: Path, how: str, why: str
) -> None:
    (tmp_path / "full").mkdir()
    if how == "disk":
        probe = "mount -t tmpfs murk full"
        can = (
            shutil.which("unshare")
            and not subprocess.run(
                ["unshare", "-rm", "sh", "-c", probe], cwd=tmp_path, capture_output=True
            ).returncode
        )
        if not can:
            pytest.skip("no file system can be mounted here")
    done = run_with_little_room(log, tmp_path, how)
    assert done.returncode == 0, done.stderr
    said = f"recording to full/drive.mcap stopped: {why}"
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert sum(line["type"] == "noise_level" for line in lines) == 300
    assert [line["detail"] for line in lines if line["type"] == "node_event"] == [said]
    assert lines[-1]["outputs"]["record"]["stopped"] == said
    written = decoded(tmp_path / ("full/drive.mcap" if how == "limit" else "kept.mcap"))
    scans = [one for one in written if isinstance(one, RadarScan)]
    assert 0 < len(scans) < 300
    assert all(np.array_equal(one.x, scan(n, 250).x) for n, one in enumerate(scans))


def test_what_was_printed_is_soon_in_the_file_and_survives_a_kill(
    log: Path, tmp_path: Path
) -> None:
    path = tmp_path / "drive.mcap"
    command = [*MURK, "run", "--radar", str(log), "--json", "--record", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=unbuffered()) as process:
        assert process.stdout is not None
        printed = [json.loads(process.stdout.readline()) for _ in range(40)]
        printed = [one for one in printed if one["type"] == "noise_level"]
        deadline_s = monotonic() + 60.0
        while len(recorded_levels(path)) < len(printed) and monotonic() < deadline_s:
            sleep(0.1)
        process.kill()
    assert process.returncode == -signal.SIGKILL
    levels = recorded_levels(path)
    assert [one.level for one in levels[: len(printed)]] == [one["level"] for one in printed]


def recorded_levels(path: Path) -> list[NoiseLevel]:
    try:
        return [one for one in decoded(path) if isinstance(one, NoiseLevel)]
    except InputError:  # no chunk is on the disk yet
        return []


def unbuffered() -> dict[str, str]:
    return {**os.environ, "PYTHONUNBUFFERED": "1"}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "drive.mcap"
    record(scene_plan(path), published(3))
    return path


def read_as_far_as_it_goes(path: Path) -> tuple[list[Entry], str | None]:
    read: list[Entry] = []
    try:
        read_recording(path)
        read.extend(open_mcap(path).entries())
    except InputError as error:
        return read, str(error)
    return read, None


def test_the_library_reads_a_file_that_was_cut_off_as_far_as_murk_does(
    whole: Path, tmp_path: Path
) -> None:
    path = tmp_path / "cut.mcap"
    content = whole.read_bytes()
    path.write_bytes(content[: content.rindex(END_OF_DATA) - 5])
    theirs: list[tuple[str, bytes]] = []
    with path.open("rb") as file, suppress(McapError, struct.error):
        for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            theirs.append((channel.topic, message.data))
    assert theirs == [(entry.topic, entry.cdr) for entry in open_mcap(path).entries()]
    assert len(theirs) == 18


END_OF_DATA = b"\x0f\x04\0\0\0\0\0\0\0"
PLACE = st.floats(0, 1, exclude_max=True)


@settings(max_examples=60)
@given(kept=st.just(1.0) | PLACE, flips=st.lists(st.tuples(PLACE, st.integers(1, 255)), max_size=3))
def test_whatever_is_done_to_a_file_it_reads_or_is_refused_in_one_line(
    whole: Path,
    tmp_path_factory: pytest.TempPathFactory,
    kept: float,
    flips: list[tuple[float, int]],
) -> None:
    content = bytearray(whole.read_bytes())
    del content[int(kept * len(content)) :]
    for place, bits in flips if content else ():
        content[int(place * len(content))] ^= bits
    path = tmp_path_factory.mktemp("damaged") / "drive.mcap"
    path.write_bytes(content)
    read, refusal = read_as_far_as_it_goes(path)
    assert refusal is None or (refusal.startswith(str(path)) and "\n" not in refusal)
    known = list(open_mcap(whole).entries())
    assert read == known[: len(read)]


def test_a_frame_is_recorded_without_loss(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(scene_plan(path), [("/murk/camera/image", frame(1))])
    assert np.array_equal(decoded(path)[0].image, frame(1).image)
