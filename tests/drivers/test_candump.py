from __future__ import annotations

import gzip
import shutil
import subprocess
from contextlib import suppress
from pathlib import Path

import can
import numpy as np
import pytest
from can_strategies import STAMPS, Row, frames_of, rows, rows_of
from hypothesis import given
from hypothesis import strategies as st

from dbc.errors import LogError
from drivers.can_frames import CanFrames, FrameFlag
from drivers.candump import read_candump, write_candump

USUAL = "(1532402927.664178) can0 701#004F5A12771FE187"
USUAL_ROW = Row(1_532_402_927_664_178_000, 0x701, 8, bytes.fromhex("004F5A12771FE187"), 0, "can0")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("candump")


def read_text(folder: Path, text: str | bytes, chunk_bytes: int = 1 << 19) -> list[Row]:
    path = folder / "text.log"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return rows_of(read_candump(path, chunk_bytes))


def read_until_error(path: Path) -> tuple[list[Row], LogError]:
    batches: list[CanFrames] = []
    with pytest.raises(LogError) as caught:
        batches.extend(read_candump(path))
    return rows_of(batches), caught.value


def console_line(row: Row, stamped: bool) -> str:
    """A line as candump prints it on a terminal with ``-x``, and with ``-ta`` if stamped."""
    if row.flags & FrameFlag.ERROR:
        identifier = f"{row.can_id | 0x20000000:08X}"
    else:
        identifier = f"{row.can_id:08X}" if row.flags & FrameFlag.EXTENDED else f"{row.can_id:03X}"
    is_fd = row.flags & FrameFlag.FD
    payload = row.data.ljust(row.length, b"\0")
    body = "".join(f" {byte:02X}" for byte in payload)
    if row.flags & FrameFlag.REMOTE:
        body = " remote request"
    elif row.flags & FrameFlag.ERROR:
        body += "   ERRORFRAME"
    elif not is_fd:
        body += "   '" + "".join(chr(b) if 0x1F < b < 0x7F else "." for b in payload) + "'"
    direction = "TX" if row.flags & FrameFlag.TRANSMITTED else "RX"
    switch = "B" if row.flags & FrameFlag.BIT_RATE_SWITCH else "-"
    error_state = "E" if row.flags & FrameFlag.ERROR_STATE else "-"
    length = f"[{row.length:02d}]" if is_fd else f" [{row.length}]"
    seconds, fraction = divmod(row.stamp_ns, 10**9)
    stamp = f" ({seconds:010d}.{fraction:09d})" if stamped else ""
    return (
        f"{stamp}  {row.channel}  {direction} {switch} {error_state}  {identifier}  {length} {body}"
    )


@given(rows(), st.integers(1, 300))
def test_what_is_written_is_read_back(folder: Path, drawn: list[Row], chunk_bytes: int) -> None:
    path = folder / "round_trip.log"
    half = len(drawn) // 2
    batches = [frames_of(part) for part in (drawn[:half], drawn[half:])]
    assert write_candump(path, batches) == len(drawn)
    if drawn:
        assert rows_of(read_candump(path, chunk_bytes)) == drawn


@given(rows(min_size=1), st.data())
def test_how_a_log_is_cut_into_chunks_changes_nothing(
    folder: Path, drawn: list[Row], data: st.DataObject
) -> None:
    path = folder / "chunks.log"
    write_candump(path, [frames_of(drawn)])
    whole = list(read_candump(path))
    chunk_bytes = data.draw(st.integers(1, path.stat().st_size))
    chunks = list(read_candump(path, chunk_bytes))
    assert len(whole) == 1
    for name in ("stamp_ns", "can_id", "length", "flags", "channel"):
        joined = np.concatenate([getattr(chunk, name) for chunk in chunks])
        np.testing.assert_array_equal(joined, getattr(whole[0], name))
        assert joined.dtype == getattr(whole[0], name).dtype
    assert whole[0].channels[: len(chunks[0].channels)] == chunks[0].channels
    assert chunks[-1].channels == whole[0].channels


@given(rows(min_size=1))
def test_lines_read_together_say_what_each_says_alone(folder: Path, drawn: list[Row]) -> None:
    path = folder / "together.log"
    write_candump(path, [frames_of(drawn)])
    together = rows_of(read_candump(path))
    lines = path.read_text().splitlines()
    assert together == [row for line in lines for row in read_text(folder, line)]


@given(rows(min_size=1), st.booleans())
def test_the_console_form_says_the_same(folder: Path, drawn: list[Row], stamped: bool) -> None:
    text = "".join(console_line(row, stamped) + "\n" for row in drawn)
    expected = drawn if stamped else [row._replace(stamp_ns=0) for row in drawn]
    assert read_text(folder, text) == expected


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (USUAL, USUAL_ROW),
        (USUAL + "\r", USUAL_ROW),
        (USUAL.lower(), USUAL_ROW),
        (USUAL + " R", USUAL_ROW),
        (USUAL + " T", USUAL_ROW._replace(flags=FrameFlag.TRANSMITTED)),
        (USUAL.replace("178)", "178001)"), USUAL_ROW._replace(stamp_ns=1532402927664178001)),
        (USUAL.replace(" can0", "   can0"), USUAL_ROW),
        (USUAL + "_B", USUAL_ROW),
        ("(0.5) can0 123#", Row(500_000_000, 0x123, 0, b"", 0, "can0")),
        ("(0000000001.0) can0 123#R", Row(10**9, 0x123, 0, b"", FrameFlag.REMOTE, "can0")),
        ("(1.0) can0 123#R8 T", Row(10**9, 0x123, 8, b"", 2 | 64, "can0")),
        ("(1.0) can0 00000123#01", Row(10**9, 0x123, 1, b"\1", FrameFlag.EXTENDED, "can0")),
        ("(1.0) can0 1FFFFFFF#01", Row(10**9, 0x1FFFFFFF, 1, b"\1", 1, "can0")),
        ("(1.0) can0 20000004#0001", Row(10**9, 4, 2, b"\0\1", FrameFlag.ERROR, "can0")),
        ("(1.0) can0 123##0", Row(10**9, 0x123, 0, b"", FrameFlag.FD, "can0")),
        ("(1.0) can0 123##311", Row(10**9, 0x123, 1, b"\x11", 8 | 16 | 32, "can0")),
        ("(1.0) can0 123##4" + "11" * 64, Row(10**9, 0x123, 64, b"\x11" * 64, 8, "can0")),
        (
            "(2020-06-05 15:46:52.436348) can0 123#01",
            Row(1_591_372_012_436_348_000, 0x123, 1, b"\1", 0, "can0"),
        ),
        (
            " (2020-06-05 15:46:52.436348)  can0  123   [1]  01",
            Row(1_591_372_012_436_348_000, 0x123, 1, b"\1", 0, "can0"),
        ),
        ("can0  600   [5]  50 24 58 11 10", Row(0, 0x600, 5, b"P$X\x11\x10", 0, "can0")),
        ("  can0  123   [2]  27 27   ''''", Row(0, 0x123, 2, b"''", 0, "can0")),
        ("  can0       123   [4]  remote request", Row(0, 0x123, 4, b"", 2, "can0")),
        ("  can0  20000088   [1]  00   ERRORFRAME", Row(0, 0x88, 1, b"", 4, "can0")),
        ("  can0  123  [01]  11", Row(0, 0x123, 1, b"\x11", FrameFlag.FD, "can0")),
    ],
)
def test_a_line_of_every_form(folder: Path, line: str, expected: Row) -> None:
    assert read_text(folder, line + "\n") == [expected]
    assert read_text(folder, line) == [expected]


BAD_LINES = [
    "hello",
    "\0\1\2\3",
    USUAL[:-1],
    USUAL[:-17],
    USUAL[:20],
    USUAL + "00",
    USUAL.replace("#", ""),
    USUAL.replace("701", "801"),
    USUAL.replace("701", "7O1"),
    USUAL.replace("701", "00701"),
    USUAL.replace("701", "40000701"),
    USUAL.replace("4F", "4G"),
    USUAL.replace("1532402927", "15324o2927"),
    USUAL.replace("1532402927", "9999999999"),
    USUAL.replace("664178", "6641780000"),
    USUAL.replace(" can0", ""),
    USUAL + " X",
    "(1.0) can0 123#R9",
    "(1.0) can0 123##",
    "(1.0) can0 123##1" + "00" * 65,
    "(2020-13-05 15:46:52.436348) can0 123#01",
    "(2020-06-05 25:46:52.436348) can0 123#01",
    "(9999-06-05 15:46:52.436348) can0 123#01",
    "can0  600   [5]  50 24 58 11",
    "can0  600   [9]  50 24 58 11 01 02 03 04 05",
    "can0  600  [65] " + " 00" * 65,
]


@pytest.mark.parametrize("bad", BAD_LINES)
def test_a_bad_line_is_named_after_all_frames_before_it(folder: Path, bad: str) -> None:
    path = folder / "bad.log"
    path.write_text(f"{USUAL}\n{USUAL}\n\n{bad}\n{USUAL}\n")
    read, error = read_until_error(path)
    assert read == [USUAL_ROW, USUAL_ROW]
    assert error.where == f"{path}:4"
    assert error.exit_code == 2
    assert "expected a candump line like" in str(error)
    assert "\n" not in str(error)


def test_a_digit_out_of_its_range_is_found_among_good_lines(folder: Path) -> None:
    path = folder / "late.log"
    good = "(2020-06-05 15:46:52.436348) can0 123#01"
    path.write_text("\n".join([good, good.replace("15:", "24:"), good]))
    read, error = read_until_error(path)
    assert len(read) == 1
    assert error.where == f"{path}:2"


@given(rows(min_size=1), rows(), st.sampled_from(BAD_LINES))
def test_the_frames_before_a_bad_line_are_exactly_those(
    folder: Path, before: list[Row], after: list[Row], bad: str
) -> None:
    path = folder / "cut.log"
    text = b""
    for part in (before, after):
        write_candump(path, [frames_of(part)])
        text += path.read_bytes() + (bad.encode() + b"\n" if part is before else b"")
    path.write_bytes(text)
    read, error = read_until_error(path)
    assert read == before
    assert error.where == f"{path}:{len(before) + 1}"


@pytest.mark.parametrize("content", [b"", b"\n\n", b"\r\n"])
def test_a_log_without_a_frame_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "empty.log"
    path.write_bytes(content)
    read, error = read_until_error(path)
    assert read == []
    assert error.where == f"{path}:1"
    assert "holds no CAN frame" in error.what


@given(st.binary(min_size=1, max_size=3000))
def test_any_bytes_give_frames_or_a_log_error(folder: Path, content: bytes) -> None:
    path = folder / "any.log"
    path.write_bytes(content)
    with suppress(LogError):
        rows_of(read_candump(path, chunk_bytes=512))


def test_a_huge_line_is_refused_without_reading_on(tmp_path: Path) -> None:
    path = tmp_path / "huge.log"
    path.write_bytes(USUAL.encode() + b"\n" + b"1" * 5_000_000)
    read, error = read_until_error(path)
    assert read == [USUAL_ROW]
    assert error.where == f"{path}:2"


def test_a_file_that_cannot_be_opened_is_named(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.log", tmp_path):
        _, error = read_until_error(path)
        assert error.where == str(path)
    with pytest.raises(LogError, match=r"cannot be written \(Is a directory\)"):
        write_candump(tmp_path, [])


def test_gzip_is_read_and_written(tmp_path: Path) -> None:
    path = tmp_path / "drive.log.gz"
    write_candump(path, [frames_of([USUAL_ROW] * 1000)])
    assert gzip.decompress(path.read_bytes()).decode() == f"{USUAL}\n" * 1000
    assert rows_of(read_candump(path)) == [USUAL_ROW] * 1000
    path.write_bytes(path.read_bytes()[:-12])
    _, error = read_until_error(path)
    assert error.where == str(path)
    path.write_bytes(USUAL.encode())
    _, error = read_until_error(path)
    assert error.where == str(path)


def test_the_explanations_of_error_frames_are_skipped(folder: Path) -> None:
    text = (
        "  can0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME\n"
        "\tcontroller-problem{rx-error-warning}\n"
        "  can0  123   [1]  01\n"
    )
    assert [row.can_id for row in read_text(folder, text)] == [4, 0x123]


@given(st.lists(st.integers(0, 999_999_998), min_size=3), st.integers(20, 500))
def test_differences_are_summed_up(folder: Path, steps: list[int], chunk_bytes: int) -> None:
    steps = [0, *steps, max(steps) + 1, 0]
    lines = [f" (000.{step:09d})  can0  123   [1]  01" for step in steps]
    read = read_text(folder, "\n".join(lines), chunk_bytes)
    assert [row.stamp_ns for row in read] == list(np.cumsum(steps))


@given(st.lists(st.integers(0, 999_999_999), min_size=1))
def test_times_since_the_start_are_taken_as_they_are(folder: Path, times: list[int]) -> None:
    times = [0, *sorted(times)]
    lines = [f" (000.{time:09d})  can0  123   [1]  01" for time in times]
    assert [row.stamp_ns for row in read_text(folder, "\n".join(lines))] == times


def test_a_negative_stamp_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="negative stamp"):
        write_candump(tmp_path / "x.log", [frames_of([USUAL_ROW._replace(stamp_ns=-1)])])


def test_more_interfaces_than_frames_can_say_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "channels.log"
    path.write_text("".join(f"(1.0) can{k} 123#\n" for k in range(257)))
    _, error = read_until_error(path)
    assert "more than 256" in error.what


def test_a_batch_without_can_fd_is_eight_bytes_wide(folder: Path) -> None:
    path = folder / "width.log"
    path.write_text(f"{USUAL}\n")
    (frames,) = read_candump(path)
    assert frames.data.shape == (1, 8)
    assert frames.stamp_source == "file"
    path.write_text(f"{USUAL}\n(1.0) can0 123##0\n")
    (frames,) = read_candump(path)
    assert frames.data.shape == (2, 64)


@given(rows(stamps=STAMPS.map(lambda stamp: stamp % 2**53 // 1000 * 1000), min_size=1))
def test_python_can_reads_what_is_written(folder: Path, drawn: list[Row]) -> None:
    drawn = [row for row in drawn if not row.flags & FrameFlag.ERROR]
    path = folder / "python_can.log"
    write_candump(path, [frames_of(drawn)])
    read = [
        Row(
            round(message.timestamp * 1e6) * 1000,
            message.arbitration_id,
            message.dlc,
            bytes(message.data).rstrip(b"\0"),
            FrameFlag.EXTENDED * message.is_extended_id
            | FrameFlag.REMOTE * message.is_remote_frame
            | FrameFlag.FD * message.is_fd
            | FrameFlag.BIT_RATE_SWITCH * message.bitrate_switch
            | FrameFlag.ERROR_STATE * message.error_state_indicator
            | FrameFlag.TRANSMITTED * (not message.is_rx),
            str(message.channel),
        )
        for message in can.CanutilsLogReader(path)
    ]
    assert read == drawn


def test_real_logs_are_read_as_python_can_reads_them(data: Path) -> None:
    logs = sorted((data / "radar").rglob("*.log"))
    assert len(logs) == 9
    for log in logs:
        read = rows_of(read_candump(log))
        messages = list(can.CanutilsLogReader(log))
        assert len(read) == len(messages)
        for row, message in zip(read, messages, strict=True):
            assert row.stamp_ns == round(message.timestamp * 1e6) * 1000
            assert row.can_id == message.arbitration_id
            assert row.length == message.dlc
            assert row.data == bytes(message.data).rstrip(b"\0")
            assert row.channel == message.channel
            assert row.flags == 0


def test_real_console_frames(data: Path) -> None:
    read = rows_of(read_candump(data / "radar" / "candump" / "two_cluster_frames.txt"))
    assert [(row.can_id, row.data.hex()) for row in read] == [
        (0x600, "5024581110"),
        (0x701, "004e81fc80200147"),
    ]


@pytest.mark.skipif(not shutil.which("log2long"), reason="can-utils are not installed")
def test_can_utils_turn_our_logs_into_their_console_form(data: Path, folder: Path) -> None:
    log = data / "radar" / "candump" / "object_mode_38s.log"
    long = subprocess.run(
        ["log2long"], input=log.read_bytes(), capture_output=True, check=True
    ).stdout
    assert read_text(folder, long) == rows_of(read_candump(log))
