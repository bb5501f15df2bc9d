"""candump logs: text to ``CanFrames`` in bulk, and back."""

from __future__ import annotations

import gzip
import io
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from dbc.errors import LogError
from drivers.can_frames import CanFrames, FrameFlag
from drivers.candump_layout import Fields, Layout, layout_of
from drivers.candump_writer import is_gzip, reason_of, write_candump

__all__ = ["read_candump", "write_candump"]

_EXPECTED = "expected a candump line like (1532402927.664178) can0 701#004F5A12771FE187"
_NO_FRAME = np.frombuffer(b"\t\r\n", np.uint8)
"""First characters of a blank line, and of the explanations that ``candump -e`` indents."""
_LONGEST_LINE = 1024
_HEAD_BYTES = 1 << 16
_FIRST_DIFFERENCE = re.compile(rb"\s*\(000\.0+\)")
_RELATIVE_STAMP = re.compile(rb"^\s*\((\d+)\.(\d+)\)", re.MULTILINE)


def read_candump(path: str | Path, chunk_bytes: int = 1 << 18) -> Iterator[CanFrames]:
    """Read a candump log, ``.gz`` included, in chunks of constant memory.

    Stamps are exact. Seconds and dates are taken as written, a date as UTC because the log does
    not name its zone. Differences (``candump -td``) are summed up from 0; they are told from times
    since the start (``-tz``) by a stamp in the first 64 KiB that is lower than the one before it.
    A line without a stamp gets 0. Blank lines and the explanations of ``candump -e`` are skipped.

    Parameters
    ----------
    path:
        The log.
    chunk_bytes:
        Bytes of text read at once.

    Yields
    ------
    CanFrames
        At least one frame each, in the order of the log; ``channels`` only grows from one to the
        next.

    Raises
    ------
    LogError
        If the file cannot be opened or holds no frame; and at the first line that is not a CAN
        frame, after all frames before it have been yielded.
    """
    reader = _LineReader()
    line_number = 1
    frame_count = 0
    last_ns = 0
    try:
        with _open(path) as file:
            are_differences = _are_differences(file.peek(_HEAD_BYTES))
            for text in _whole_lines(file, chunk_bytes):
                lines = _Lines.of(text)
                frames, good = reader.read(lines)
                if are_differences and len(frames):
                    frames = replace(frames, stamp_ns=last_ns + np.cumsum(frames.stamp_ns))
                    last_ns = int(frames.stamp_ns[-1])
                if len(frames):
                    frame_count += len(frames)
                    yield frames
                if good < len(lines):
                    raise _bad_line(f"{path}:{line_number + lines.number[good]}", lines[good])
                line_number += text.count(b"\n")
    except (OSError, EOFError, OverflowError, zlib.error) as error:
        raise LogError(path, f"cannot be read ({reason_of(error)})", _EXPECTED) from error
    if not frame_count:
        raise LogError(f"{path}:1", "holds no CAN frame", _EXPECTED)


@contextmanager
def _open(path: str | Path) -> Iterator[io.BufferedReader]:
    with gzip.open(path) if is_gzip(path) else Path(path).open("rb", buffering=0) as raw:
        yield io.BufferedReader(cast(io.RawIOBase, raw), _HEAD_BYTES)


def _are_differences(head: bytes) -> bool:
    if not _FIRST_DIFFERENCE.match(head):
        return False
    stamps = [(int(seconds), fraction) for seconds, fraction in _RELATIVE_STAMP.findall(head)]
    return any(later < earlier for earlier, later in pairwise(stamps))


def _whole_lines(file: io.BufferedReader, chunk_bytes: int) -> Iterator[bytes]:
    """Yield text that ends at the end of a line; a newline is added where the file lacks it."""
    rest = b""
    while chunk := file.read(chunk_bytes):
        text = rest + chunk
        end = text.rfind(b"\n") + 1
        if end:
            yield text[:end]
        rest = text[end:]
        if len(rest) > _LONGEST_LINE:
            break
    if rest:
        yield rest + b"\n"


@dataclass(frozen=True, slots=True, eq=False)
class _Lines:
    """The lines of a text that may hold frames: where they start, how long, which they are."""

    text: bytes
    start: NDArray[np.intp]
    length: NDArray[np.intp]
    number: NDArray[np.intp]

    @classmethod
    def of(cls, text: bytes) -> _Lines:
        chars = np.frombuffer(text, np.uint8)
        end = np.flatnonzero(chars == ord("\n"))
        start = np.concatenate(([0], end[:-1] + 1))
        number = np.flatnonzero(~np.isin(chars[start], _NO_FRAME))
        return cls(text, start[number], (end - start)[number], number)

    def __len__(self) -> int:
        return len(self.start)

    def __getitem__(self, row: int) -> bytes:
        return self.text[self.start[row] : self.start[row] + self.length[row]]

    def characters(self, rows: NDArray[np.intp]) -> NDArray[np.uint8]:
        """Return lines of one length L as (L, n) characters."""
        chars = np.frombuffer(self.text, np.uint8)
        windows = np.lib.stride_tricks.sliding_window_view(chars, int(self.length[rows[0]]))
        return np.ascontiguousarray(windows[self.start[rows]].T)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """Lines of one layout, by their rows in rising order, and what they say."""

    rows: NDArray[np.intp]
    layout: Layout
    fields: Fields


class _LineReader:
    """Reads lines; the layouts and channels that it has met are known from then on."""

    def __init__(self) -> None:
        self._layouts: dict[int, list[Layout]] = {}
        self._channels: dict[str, int] = {}

    def read(self, lines: _Lines) -> tuple[CanFrames, int]:
        """Return the frames before the first line that is none, and how many they are."""
        parts: list[_Part] = []
        good = len(lines)
        for length in np.flatnonzero(np.bincount(lines.length)).tolist():
            rows = np.flatnonzero(lines.length == length)
            known = self._layouts.setdefault(length, [])
            for layout in known:
                rows = _read_layout(layout, lines, rows, parts)
            while len(rows) and rows[0] < good:
                first = rows[0]
                new = layout_of(lines[first])
                if new is not None:
                    known.append(new)
                    rows = _read_layout(new, lines, rows, parts)
                if first in rows[:1]:
                    good = int(first)
        parts.sort(key=lambda part: int(part.rows[0]))
        return self._join(parts, good), good

    def _join(self, parts: list[_Part], count: int) -> CanFrames:
        """Put the parts' rows below ``count`` in order; a new channel gets the next index."""
        parts = [part for part in parts if part.rows[0] < count]
        is_fd = any(FrameFlag.FD in part.layout.flags for part in parts)
        stamp_ns = np.empty(count, np.int64)
        can_id = np.empty(count, np.uint32)
        length = np.empty(count, np.uint8)
        data = np.zeros((count, 64 if is_fd else 8), np.uint8)
        flags = np.empty(count, np.uint8)
        channel = np.empty(count, np.uint8)
        for part in parts:
            rows = part.rows[: np.searchsorted(part.rows, count)]
            stamp_ns[rows] = part.fields.stamp_ns[: len(rows)]
            can_id[rows] = part.fields.can_id[: len(rows)]
            length[rows] = part.layout.length
            data[rows, : part.fields.data.shape[1]] = part.fields.data[: len(rows)]
            flags[rows] = part.fields.flags[: len(rows)]
            channel[rows] = self._channel(part.layout.channel)
        channels = tuple(self._channels)
        return CanFrames(stamp_ns, can_id, length, data, flags, channel, channels)

    def _channel(self, name: str) -> int:
        if len(self._channels) == 256 and name not in self._channels:
            raise OverflowError("it names more than 256 CAN interfaces")
        return self._channels.setdefault(name, len(self._channels))


def _read_layout(
    layout: Layout, lines: _Lines, rows: NDArray[np.intp], parts: list[_Part]
) -> NDArray[np.intp]:
    """Add the rows that have a layout to the parts; return those that have not."""
    if not len(rows):
        return rows
    fields = layout.read(lines.characters(rows))
    if fields.fits.all():
        parts.append(_Part(rows, layout, fields))
    elif fields.fits.any():
        parts.append(_Part(rows[fields.fits], layout, fields.select(fields.fits)))
    return rows[~fields.fits]


def _bad_line(where: str, line: bytes) -> LogError:
    beginning = repr(line[:40])[1:]
    return LogError(where, f"no CAN frame in the line {beginning}", _EXPECTED)
