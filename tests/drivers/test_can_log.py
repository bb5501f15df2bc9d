from __future__ import annotations

import gc
import gzip
from pathlib import Path

import can
import pytest
from can_strategies import Row, frames_of, rows, rows_of
from hypothesis import given
from hypothesis import strategies as st

from dbc.errors import LogError
from drivers.can_frames import CanFrames, FrameFlag
from drivers.can_log import read_log
from drivers.can_messages import from_messages, to_messages
from drivers.candump import write_candump

START_NS = 1_532_402_927_664_178_000
DRIVE = [
    Row(START_NS + k * 250_000, 0x701 + k % 2, 8, bytes([k % 256, 1, 2, 3, 4, 5, 6, 7]), 0, "can0")
    for k in range(10_000)
]
MIXED = [
    Row(START_NS, 0x123, 3, b"\1\2\3", 0, "can0"),
    Row(START_NS + 1_000, 0x1ABCDEF, 1, b"\xff", FrameFlag.EXTENDED, "can0"),
    Row(START_NS + 2_000, 0x7FF, 0, b"", FrameFlag.TRANSMITTED, "can0"),
    Row(START_NS + 3_000, 0x7FF, 0, b"", FrameFlag.REMOTE, "can0"),
]


def write_by_python_can(path: Path, drawn: list[Row]) -> None:
    with can.Logger(path) as writer:
        for message in to_messages(frames_of(drawn)):
            writer.on_message_received(message)


def read_until_error(path: Path) -> tuple[list[Row], LogError]:
    batches: list[CanFrames] = []
    with pytest.raises(LogError) as caught:
        batches.extend(read_log(path))
    return rows_of(batches), caught.value


@given(rows(stamps=st.just(START_NS)))
def test_messages_keep_all_that_frames_say(drawn: list[Row]) -> None:
    frames = frames_of(drawn)
    back = from_messages(list(to_messages(frames)), frames.channels, frames.channel)
    assert rows_of([back]) == drawn


# python-can cannot write remote frames to .trc, and loses what it has not yet flushed to .db
@pytest.mark.parametrize("suffix", ["asc", "asc.gz", "blf", "csv", "db", "trc"])
@pytest.mark.parametrize("drawn", [DRIVE, MIXED], ids=["drive", "mixed"])
def test_what_python_can_writes_is_read_back(tmp_path: Path, suffix: str, drawn: list[Row]) -> None:
    path = tmp_path / f"drive.{suffix}"
    if suffix == "trc":
        drawn = [row for row in drawn if not row.flags & FrameFlag.REMOTE]
    if suffix == "db":
        drawn = drawn[:100]
    write_by_python_can(path, drawn)
    read = rows_of(read_log(path))
    assert [row.can_id for row in read] == [row.can_id for row in drawn]
    assert [row.data for row in read] == [row.data for row in drawn]
    assert [row.length for row in read] == [row.length for row in drawn]
    said = ~0 if suffix not in ("csv", "db") else ~FrameFlag.TRANSMITTED
    assert [row.flags for row in read] == [row.flags & said for row in drawn]
    offset_ns = read[0].stamp_ns - drawn[0].stamp_ns
    error_ns = [
        abs(row.stamp_ns - offset_ns - want.stamp_ns) for row, want in zip(read, drawn, strict=True)
    ]
    assert max(error_ns) <= 1_000
    if suffix in ("blf", "csv", "db", "trc"):
        assert abs(offset_ns) <= 1_000_000
    else:
        assert read[0].stamp_ns < 1_000_000


@pytest.mark.parametrize("name", ["a.log", "a.LOG", "a.txt", "a.candump", "a.log.gz"])
def test_candump_text_is_read_by_any_of_its_suffixes(tmp_path: Path, name: str) -> None:
    write_candump(tmp_path / name, [frames_of(DRIVE)])
    assert rows_of(read_log(tmp_path / name)) == DRIVE


def test_a_long_log_comes_in_batches(tmp_path: Path) -> None:
    path = tmp_path / "drive.blf"
    write_by_python_can(path, DRIVE)
    assert max(len(batch) for batch in read_log(path)) < len(DRIVE)


@pytest.mark.parametrize("name", ["drive.pcap", "drive", "drive.pcap.gz"])
def test_an_unknown_suffix_is_refused_with_the_known_ones(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"x")
    _, error = read_until_error(tmp_path / name)
    assert ".blf" in error.remedy
    assert ".log" in error.remedy


# python-can's reader of .blf leaves closing the file to the garbage collector
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("suffix", ["asc", "blf", "csv", "db", "mf4", "trc", "log", "asc.gz"])
@pytest.mark.parametrize(
    "content", [b"", b"\0\1\2\xff" * 100, b"hello\nworld\n", b"LOGG" + bytes(200)]
)
def test_wrong_content_is_one_line(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"wrong.{suffix}"
    path.write_bytes(gzip.compress(content) if suffix == "asc.gz" else content)
    read, error = read_until_error(path)
    assert read == []
    assert str(error).startswith(str(path))
    assert len(str(error)) < 400
    del error
    gc.collect()


@pytest.mark.parametrize("suffix", ["asc", "blf", "csv", "db", "mf4", "trc", "log", "log.gz"])
def test_a_missing_file_is_named_and_not_made(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"missing.{suffix}"
    _, error = read_until_error(path)
    assert error.where == str(path)
    assert not path.exists()


def test_a_truncated_log_gives_what_comes_before(tmp_path: Path) -> None:
    path = tmp_path / "cut.csv"
    write_by_python_can(path, DRIVE)
    path.write_bytes(path.read_bytes()[:-20])
    read, error = read_until_error(path)
    assert len(read) == len(DRIVE) - 1
    assert f"after frame {len(DRIVE) - 1}" in error.where


@pytest.mark.parametrize(
    "line", ["nan,0x1,0,0,0,0,", "1,0x1,0,0,0,900,", "1,0x801,0,0,0,0,", "1e30,0x1,0,0,0,0,"]
)
def test_impossible_values_are_refused(tmp_path: Path, line: str) -> None:
    path = tmp_path / "impossible.csv"
    path.write_text(f"header\n1,0x123,0,0,0,1,AA==\n{line}\n")
    read, error = read_until_error(path)
    assert [row.can_id for row in read] == [0x123]
    assert "cannot be read as .csv" in error.what
