"""The grammar of candump lines, and reading all lines of one layout at once.

Two regular expressions know every form that candump writes: compact (``-l``, ``-L``) and console,
classic, extended, remote, error and CAN FD frames, directions, and stamps in seconds or as dates.
The lines of a log repeat a handful of layouts, so the grammar looks at one line of each and says in
which columns its parts stand; every line with the same text in the other columns is then read by
array operations.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from drivers.can_frames import FrameFlag

Chars = NDArray[np.uint8]
Columns = NDArray[np.intp]

_STAMP = (
    rb"(?:\((?:(?P<day>\d{4}-\d\d-\d\d) (?P<time>[0-2]\d:[0-5]\d:[0-5]\d)|(?P<seconds>\d{1,10}))"
    rb"\.(?P<fraction>\d{1,9})\)\s+)?"
)
_CHANNEL = rb"(?P<channel>[^\s()#]+)\s+"
_ID = rb"(?P<id>[\dA-Fa-f]{8}|[\dA-Fa-f]{3})"
_COMPACT = re.compile(
    rb"\s*" + _STAMP + _CHANNEL + _ID + rb"#(?:[Rr](?P<remote>[0-8]?)"
    rb"|(?:#(?P<fd_flags>[\dA-Fa-f]))?(?P<data>(?:[\dA-Fa-f]{2}){0,64}))(?:_[9A-Fa-f])?"
    rb"(?:\s+(?P<direction>[TR]))?\s*"
)
_CONSOLE = re.compile(
    rb"\s*" + _STAMP + _CHANNEL + rb"(?:(?P<direction>[TR])X (?P<fd_flags>[-B] [-E])\s+)?" + _ID +
    rb"\s+\[(?P<length>\d\d?)\] ?(?: (?P<remote>remote request)"
    rb"|(?P<data>(?: [\dA-Fa-f]{2}){0,64}))(?:\s+(?:'(?P<ascii>.*)'|ERRORFRAME))?\s*"
)  # fmt: skip

_ERROR_BIT = 0x20000000

_LARGEST_STAMP_NS = 2**63 - 1
_DAY_NS = 86_400 * 10**9
_TIME_COLUMNS = (0, 1, 3, 4, 6, 7)
_TIME_LIMITS = (3, 10, 6, 10, 6, 10)
_TIME_SECONDS = (36_000, 3_600, 600, 60, 10, 1)

_NIBBLE = np.full(256, 16, np.uint8)
"""Value of a hexadecimal digit by its character; 16 where it is none."""
_NIBBLE[np.frombuffer(b"0123456789ABCDEFabcdef", np.uint8)] = [*range(16), *range(10, 16)]


@dataclass(frozen=True, slots=True, eq=False)
class Fields:
    """What n lines say that were read by one layout.

    Attributes
    ----------
    fits:
        (n,) bool, whether a line has the layout; the other arrays mean nothing where it has not.
    stamp_ns:
        (n,) int64, 0 where the layout has no stamp.
    can_id:
        (n,) uint32, without flag bits.
    flags:
        (n,) uint8 of ``FrameFlag`` bits.
    data:
        (n, k) uint8, the k payload bytes written in the line.
    """

    fits: NDArray[np.bool_]
    stamp_ns: NDArray[np.int64]
    can_id: NDArray[np.uint32]
    flags: NDArray[np.uint8]
    data: NDArray[np.uint8]

    def select(self, rows: NDArray[np.bool_]) -> Fields:
        """Return what some of the lines say."""
        return Fields(
            self.fits[rows],
            self.stamp_ns[rows],
            self.can_id[rows],
            self.flags[rows],
            self.data[rows],
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Stamp:
    """A stamp's digits: their columns, their limits (exclusive) and what each is worth in ns."""

    columns: Columns
    limits: NDArray[np.uint8]
    weights_ns: NDArray[np.uint64]
    base_ns: int
    largest_ns: int

    def read(self, chars: Chars) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        digits = chars[self.columns] - np.uint8(ord("0"))
        value = np.zeros(chars.shape[1], np.uint64)
        for digit, weight_ns in zip(digits, self.weights_ns, strict=True):
            value += digit * weight_ns
        fits = (digits < self.limits[:, None]).all(axis=0) & (value <= self.largest_ns)
        return fits, value.astype(np.int64) + self.base_ns


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """In which columns of a line the parts of a CAN frame stand.

    Attributes
    ----------
    channel:
        Name of the interface.
    length:
        Payload bytes, or those that a remote frame asks for.
    flags:
        ``FrameFlag`` bits that all frames of the layout have.
    """

    channel: str
    length: int
    flags: FrameFlag
    fixed: Columns
    fixed_text: Chars
    stamp: _Stamp
    identifier: Columns
    payload: Columns

    def read(self, chars: Chars) -> Fields:
        """Read n lines of one length L, given as (L, n) uint8 characters."""
        fits, stamp_ns = self.stamp.read(chars)
        fits &= (chars[self.fixed] == self.fixed_text[:, None]).all(axis=0)

        digits = _NIBBLE.take(chars[self.identifier])
        weights = np.array([16**k for k in reversed(range(len(digits)))], np.uint32)
        can_id = weights @ digits
        fits &= (digits < 16).all(axis=0) & (can_id < (0x800 if len(digits) == 3 else 0x40000000))
        flags = np.full(len(can_id), self.flags, np.uint8)
        if len(digits) == 8:
            is_error = (can_id & _ERROR_BIT).astype(np.bool_)
            flags |= np.where(is_error, FrameFlag.ERROR, FrameFlag.EXTENDED).astype(np.uint8)

        high, low = _NIBBLE.take(chars[self.payload]), _NIBBLE.take(chars[self.payload + 1])
        fits &= ((high | low) < 16).all(axis=0)
        return Fields(
            fits, stamp_ns, can_id & ~np.uint32(_ERROR_BIT), flags, np.bitwise_or(high << 4, low).T
        )


def layout_of(line: bytes) -> Layout | None:
    """Return the layout of a line without its newline; None where it is no CAN frame."""
    match = _COMPACT.fullmatch(line) or _CONSOLE.fullmatch(line)
    if match is None:
        return None
    flags, payload, stamp = _flags(match), _payload(match), _stamp(match)
    length = _length(match, flags, len(payload))
    if stamp is None or length is None:
        return None
    identifier = _span(match, "id")
    parts = (stamp.columns, identifier, payload, payload + 1, _span(match, "ascii"))
    fixed = np.setdiff1d(np.arange(len(line)), np.concatenate(parts))
    return Layout(
        channel=match["channel"].decode(errors="replace"),
        length=length,
        flags=flags,
        fixed=fixed,
        fixed_text=np.frombuffer(line, np.uint8)[fixed],
        stamp=stamp,
        identifier=identifier,
        payload=payload,
    )


def _span(match: re.Match[bytes], part: str) -> Columns:
    return np.arange(*(match.span(part) if part in match.re.groupindex else (0, 0)))


def _flags(match: re.Match[bytes]) -> FrameFlag:
    flags = FrameFlag(0)
    if match["remote"] is not None:
        flags |= FrameFlag.REMOTE
    if match["direction"] == b"T":
        flags |= FrameFlag.TRANSMITTED
    if match.re is _CONSOLE:
        # the console form writes the length of a CAN FD frame with two digits
        is_fd, fd_flags = len(match["length"]) == 2, match["fd_flags"] or b""
        switch, error_state = b"B" in fd_flags, b"E" in fd_flags
    else:
        is_fd, nibble = match["fd_flags"] is not None, int(match["fd_flags"] or b"0", 16)
        switch, error_state = bool(nibble & 1), bool(nibble & 2)
    if is_fd:
        flags |= FrameFlag.FD
        flags |= FrameFlag.BIT_RATE_SWITCH if switch else FrameFlag(0)
        flags |= FrameFlag.ERROR_STATE if error_state else FrameFlag(0)
    return flags


def _payload(match: re.Match[bytes]) -> Columns:
    """Return the columns of the high digits of the payload's bytes."""
    if match.re is _CONSOLE:
        return _span(match, "data")[1::3]
    return _span(match, "data")[::2]


def _length(match: re.Match[bytes], flags: FrameFlag, written: int) -> int | None:
    """Return the frame's length; None where it is too long or not what was announced."""
    announced = match["length"] if match.re is _CONSOLE else match["remote"]
    length = int(announced or 0) if FrameFlag.REMOTE in flags else written
    if length > (64 if FrameFlag.FD in flags else 8):
        return None
    if match.re is _CONSOLE and length != int(announced):
        return None
    return length


def _stamp(match: re.Match[bytes]) -> _Stamp | None:
    """Return where the stamp's digits stand; None where its day cannot be said in nanoseconds."""
    if match["fraction"] is None:
        return _stamp_of([], base_ns=0, largest_ns=0)
    fraction = _span(match, "fraction")
    digits = [(column, 10, 10 ** (8 - k)) for k, column in enumerate(fraction)]
    if match["seconds"] is not None:
        seconds = _span(match, "seconds")
        digits += [(column, 10, 10 ** (9 + k)) for k, column in enumerate(seconds[::-1])]
        return _stamp_of(digits, base_ns=0, largest_ns=_LARGEST_STAMP_NS)
    try:
        day = datetime.strptime(match["day"].decode(), "%Y-%m-%d").replace(tzinfo=UTC)
    except ValueError:
        return None
    base_ns = int(day.timestamp()) * 10**9
    if base_ns + _DAY_NS > _LARGEST_STAMP_NS:
        return None
    time = match.start("time") + np.array(_TIME_COLUMNS)
    weights = [seconds * 10**9 for seconds in _TIME_SECONDS]
    digits += zip(time, _TIME_LIMITS, weights, strict=True)
    return _stamp_of(digits, base_ns, largest_ns=_DAY_NS - 1)


def _stamp_of(digits: list[tuple[int, int, int]], base_ns: int, largest_ns: int) -> _Stamp:
    columns, limits, weights_ns = zip(*digits, strict=True) if digits else ((), (), ())
    return _Stamp(
        columns=np.array(columns, np.intp),
        limits=np.array(limits, np.uint8),
        weights_ns=np.array(weights_ns, np.uint64),
        base_ns=base_ns,
        largest_ns=largest_ns,
    )
