"""Decode and encode many payloads of one CAN message at once, as a DBC file describes it.

cantools reads the DBC file. Each message is then compiled to a plan: a signal is one piece of an
eight-byte word (two pieces where it touches nine bytes), reached by two shifts, and becomes
physical by one multiplication and one addition. Both are done for all payloads, and for all
ordinary signals of a word, at once.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import Any

import cantools.database
import numpy as np
from cantools.database.can import Database as ParsedDatabase
from cantools.database.can import Message as ParsedMessage
from cantools.database.can import Signal as ParsedSignal
from numpy.typing import ArrayLike, NDArray

from dbc.errors import DatabaseError, InputError

Payloads = NDArray[np.uint8]
Words = NDArray[np.uint64]

WORD_BYTES = 8
WORD_BITS = 64
FLOAT64_INTEGERS = 1 << 53  # every integer up to this is a float64
EXTENDED_ID = 1 << 31  # how a DBC file marks a 29-bit identifier

_UINT_OF_FLOAT = {16: np.uint16, 32: np.uint32, 64: np.uint64}
_FLOAT = {16: np.float16, 32: np.float32, 64: np.float64}


@dataclass(frozen=True, slots=True)
class _Piece:
    """Consecutive bits of a signal inside one word.

    ``(word << left) >> right`` leaves these bits right-aligned; ``up`` is their place in the
    signal.
    """

    word: int
    left: np.uint64
    right: np.uint64
    up: np.uint64


@dataclass(frozen=True, slots=True)
class _Signal:
    """How one signal is cut out of the words and scaled."""

    parsed: ParsedSignal
    name: str
    pieces: tuple[_Piece, ...]
    bits: int
    signed: bool
    is_float: bool
    scale: float
    offset: float

    @property
    def raw_range(self) -> tuple[int, int]:
        """Smallest and largest raw integer."""
        if self.signed:
            return -(1 << (self.bits - 1)), (1 << (self.bits - 1)) - 1
        return 0, (1 << self.bits) - 1

    @property
    def physical_range(self) -> tuple[float, float]:
        """Physical value of the smallest and the largest raw integer."""
        low, high = self.raw_range
        return low * self.scale + self.offset, high * self.scale + self.offset

    @property
    def is_integer(self) -> bool:
        """Whether every physical value is an integer."""
        return not self.is_float and isinstance(self.scale, int) and isinstance(self.offset, int)

    @property
    def is_ordinary(self) -> bool:
        """Whether a block may decode it: one piece, and an unscaled integer or a scaled float."""
        plain = len(self.pieces) == 1 and not self.is_float
        narrow = self.signed or self.bits < WORD_BITS
        if self.is_integer:
            return plain and narrow and self.scale == 1 and self.offset == 0
        return plain and narrow and max(map(abs, self.physical_range)) < sys.float_info.max

    def raw(self, words: list[Words]) -> NDArray[Any]:
        """Cut the raw value out: int64, uint64 for 64 unsigned bits, or a float type."""
        first = self.pieces[0]
        shift = np.uint64(WORD_BITS - self.bits)
        if len(self.pieces) == 1:
            top = words[first.word] << first.left
        else:
            parts = (((words[p.word] << p.left) >> p.right) << p.up for p in self.pieces)
            top = np.bitwise_or(*parts) << shift
        if self.signed:
            return top.view(np.int64) >> shift.view(np.int64)
        value = top >> shift
        if self.is_float:
            return value.astype(_UINT_OF_FLOAT[self.bits]).view(_FLOAT[self.bits])
        return value if self.bits == WORD_BITS else value.view(np.int64)

    def physical(self, raw: NDArray[Any]) -> NDArray[Any]:
        """Scale raw values as cantools does: in integers where 64 bits do, else in float64."""
        if self.scale == 1 and self.offset == 0:
            return raw
        low, high = self.physical_range
        if self.is_integer and max(abs(low), abs(high), abs(self.scale)) < 1 << 63:
            return raw.astype(np.int64) * self.scale + self.offset
        with np.errstate(over="ignore", invalid="ignore"):  # a float may be anything
            return raw.astype(np.float64) * self.scale + self.offset

    def to_raw(self, values: NDArray[Any]) -> NDArray[Any]:
        """Undo ``physical``: the nearest raw value, half to even, not yet checked for range."""
        if values.dtype.kind in "iu" and self.is_integer:
            largest = max(abs(bound) for bound in self.physical_range)
            if largest > FLOAT64_INTEGERS:  # rare enough for cantools' own exact arithmetic
                convert = self.parsed.conversion.numeric_scaled_to_raw
                return np.array([convert(value) for value in values.tolist()], dtype=object)
        with np.errstate(over="ignore", invalid="ignore"):  # to_bits refuses what overflows
            raw = (values.astype(np.float64) - self.offset) / self.scale
        return raw if self.is_float else np.rint(raw)

    def to_bits(self, raw: NDArray[Any], where: str) -> Words:
        """Check raw values for range and return their bits, right-aligned."""
        if self.is_float:
            with np.errstate(over="ignore", invalid="ignore"):
                narrow = raw.astype(_FLOAT[self.bits])
            self._refuse(np.isinf(narrow) & ~np.isinf(raw), raw, where)
            return narrow.view(_UINT_OF_FLOAT[self.bits]).astype(np.uint64)
        low, high = self.raw_range
        # float(2**64 - 1) is 2**64, so the upper bound is checked with "less than"
        self._refuse(~((raw >= low) & (raw < high + 1)), raw, where)
        integers = raw.astype(np.int64 if self.signed else np.uint64).view(np.uint64)
        return integers & np.uint64((1 << self.bits) - 1)

    def _refuse(self, bad: NDArray[np.bool_], raw: NDArray[Any], where: str) -> None:
        if bad.any():
            value = raw[bad][0] * self.scale + self.offset
            low, high = sorted(self.physical_range)
            expected = f"a {self.bits}-bit float" if self.is_float else f"{low:.12g} to {high:.12g}"
            raise InputError(f"{where}.{self.name}", f"{value:.12g} is out of range", expected)


class _Block:
    """Ordinary signals of one word, cut out together and scaled together."""

    def __init__(self, signals: list[_Signal]) -> None:
        def column(values: list[Any]) -> NDArray[Any]:
            return np.array(values)[:, None]

        unscaled = [signal for signal in signals if signal.is_integer]
        scaled = [signal for signal in signals if not signal.is_integer]
        pieces = [signal.pieces[0] for signal in unscaled + scaled]
        self.names = [signal.name for signal in unscaled + scaled]
        self._unscaled = len(unscaled)
        self._word = pieces[0].word
        self._left = column([piece.left for piece in pieces])
        self._right = column([piece.right for piece in pieces])
        self._signed = signals[0].signed
        self._scale = column([float(signal.scale) for signal in scaled])
        self._offset = column([float(signal.offset) for signal in scaled])

    def raw(self, words: list[Words]) -> NDArray[np.int64]:
        """Return the raw values, (signals, N)."""
        bits = words[self._word] << self._left
        values: NDArray[np.int64] = bits.view(np.int64)
        if self._signed:
            values >>= self._right.view(np.int64)
        else:
            bits >>= self._right
        return values

    def physical(self, words: list[Words]) -> Iterator[NDArray[Any]]:
        """Return the physical values, (N,) a signal."""
        raw = self.raw(words)
        scaled = raw[self._unscaled :].astype(np.float64)
        scaled *= self._scale
        scaled += self._offset
        return chain(raw[: self._unscaled], scaled)


class MessageCodec:
    """One message of a DBC file, compiled.

    Parameters
    ----------
    message:
        What cantools parsed.

    Raises
    ------
    DatabaseError
        If the message is multiplexed, has a signal of over 64 bits, a float of other than 16, 32
        or 64 bits, or a scale of 0.

    Attributes
    ----------
    name, id, length:
        The message's name, frame identifier and payload bytes.
    signals:
        Names of its signals.
    """

    def __init__(self, message: ParsedMessage) -> None:
        self.name: str = message.name
        self.id: int = message.frame_id
        self.length: int = message.length
        if message.is_multiplexed():
            raise DatabaseError(self.name, "is multiplexed", "decode it frame by frame")
        self._windows: list[tuple[int, str]] = []
        self._signals = [self._compile(signal) for signal in message.signals]
        self.signals: tuple[str, ...] = tuple(signal.name for signal in self._signals)
        self._blocks = self._gather()
        self._others = [signal for signal in self._signals if not signal.is_ordinary]

    def decode(self, payloads: Payloads) -> dict[str, NDArray[Any]]:
        """Return the physical values.

        Parameters
        ----------
        payloads:
            (N, at least ``length``) uint8; further bytes are ignored.

        Returns
        -------
        dict
            Signal name → (N,) array. A signal whose scale and offset are integers gives int64
            (unscaled 64 unsigned bits uint64; what may pass 64 bits float64); every other one
            gives float64, equal to cantools' value to the last bit (signals of over 53 bits,
            which a float64 cannot hold: to the last but one).

        Raises
        ------
        InputError
            If a payload is shorter than the message.
        """
        words = self._words(payloads)
        columns: dict[str, NDArray[Any]] = {}
        for block in self._blocks:
            columns |= zip(block.names, block.physical(words), strict=True)
        for signal in self._others:
            columns[signal.name] = signal.physical(signal.raw(words))
        return columns

    def decode_raw(self, payloads: Payloads) -> dict[str, NDArray[Any]]:
        """Return the raw values: int64, uint64 for 64 unsigned bits, float for float signals."""
        words = self._words(payloads)
        columns: dict[str, NDArray[Any]] = {}
        for block in self._blocks:
            columns |= zip(block.names, block.raw(words), strict=True)
        for signal in self._others:
            columns[signal.name] = signal.raw(words)
        return columns

    def encode(self, values: Mapping[str, ArrayLike]) -> Payloads:
        """Return payloads that carry physical values, each rounded to the nearest raw value.

        Parameters
        ----------
        values:
            Signal name → (N,) array or scalar, for every signal of the message.

        Returns
        -------
        ndarray
            (N, ``length``) uint8, bits without signal 0.

        Raises
        ------
        InputError
            If a value does not fit its signal, a signal is missing or unknown, or the arrays
            differ in length.
        """
        arrays = self._arrays(values)
        return self._pack([signal.to_raw(arrays[signal.name]) for signal in self._signals])

    def encode_raw(self, values: Mapping[str, ArrayLike]) -> Payloads:
        """Return payloads that carry raw values; otherwise as ``encode``."""
        arrays = self._arrays(values)
        return self._pack([arrays[signal.name] for signal in self._signals])

    def _compile(self, signal: ParsedSignal) -> _Signal:
        bits = signal.length
        is_float = bool(signal.is_float)
        scale, offset = signal.scale, signal.offset
        where = f"{self.name}.{signal.name}"
        if bits > WORD_BITS:
            raise DatabaseError(where, f"has {bits} bits", f"up to {WORD_BITS} can be decoded")
        if is_float and bits not in _FLOAT:
            raise DatabaseError(where, f"is a {bits}-bit float", "expected 16, 32 or 64 bits")
        if scale == 0 or max(abs(scale), abs(offset)) > sys.float_info.max:
            raise DatabaseError(where, f"has scale {scale}, offset {offset}", "expected numbers")
        if float(scale).is_integer() and float(offset).is_integer():
            scale, offset = int(scale), int(offset)
        return _Signal(
            parsed=signal,
            name=signal.name,
            pieces=self._pieces(signal),
            bits=bits,
            signed=bool(signal.is_signed) and not is_float,
            is_float=is_float,
            scale=scale,
            offset=offset,
        )

    def _gather(self) -> list[_Block]:
        groups: dict[tuple[int, bool], list[_Signal]] = {}
        for signal in self._signals:
            if signal.is_ordinary:
                groups.setdefault((signal.pieces[0].word, signal.signed), []).append(signal)
        return [_Block(group) for group in groups.values()]

    def _pieces(self, signal: ParsedSignal) -> tuple[_Piece, ...]:
        """Cut a signal where its ninth byte begins; both byte orders count from the first byte."""
        big = signal.byte_order == "big_endian"
        byte, bit = divmod(signal.start, 8)
        skipped = 7 - bit if big else bit
        first = min(signal.length, WORD_BITS - skipped)
        rest = signal.length - first
        pieces = [self._piece(big, byte, skipped, first, up=rest if big else 0)]
        if rest:
            pieces.append(self._piece(big, byte + WORD_BYTES, 0, rest, up=0 if big else first))
        return tuple(pieces)

    def _piece(self, big: bool, byte: int, skipped: int, bits: int, up: int) -> _Piece:
        start = max(0, min(byte, self.length - WORD_BYTES))
        skipped += 8 * (byte - start)
        window = (start, ">u8" if big else "<u8")
        if window not in self._windows:
            self._windows.append(window)
        return _Piece(
            word=self._windows.index(window),
            left=np.uint64(skipped if big else WORD_BITS - skipped - bits),
            right=np.uint64(WORD_BITS - bits),
            up=np.uint64(up),
        )

    def _words(self, payloads: Payloads) -> list[Words]:
        if payloads.ndim != 2 or payloads.shape[1] < self.length:
            shape = "x".join(map(str, payloads.shape))
            raise InputError(self.name, f"payloads {shape}", f"expected N x {self.length} bytes")
        if payloads.shape[1] < WORD_BYTES:
            missing = WORD_BYTES - payloads.shape[1]
            payloads = np.pad(payloads, ((0, 0), (0, missing)))
        payloads = np.ascontiguousarray(payloads)
        return [
            payloads[:, start : start + WORD_BYTES].view(order)[:, 0].astype(np.uint64)
            for start, order in self._windows
        ]

    def _arrays(self, values: Mapping[str, ArrayLike]) -> dict[str, NDArray[Any]]:
        """Bring values to one length; a message of no signals has no length and gives none."""
        for name in self.signals:
            if name not in values:
                raise InputError(f"{self.name}.{name}", "has no value", "every signal needs one")
        for name in values:
            if name not in self.signals:
                raise InputError(f"{self.name}.{name}", "is not a signal of this message")
        arrays = {name: np.atleast_1d(np.asarray(value)) for name, value in values.items()}
        for name, array in arrays.items():
            if array.ndim != 1 or array.dtype.kind not in "biuf":
                raise InputError(f"{self.name}.{name}", "is not a column of numbers")
        lengths = {len(array) for array in arrays.values()}
        size = next(iter(lengths - {1}), 1)
        if lengths - {1, size}:
            raise InputError(self.name, f"columns of {sorted(lengths)} values", "expected one N")
        return {name: np.broadcast_to(array, size) for name, array in arrays.items()}

    def _pack(self, raws: list[NDArray[Any]]) -> Payloads:
        size = len(raws[0]) if raws else 0
        words = [np.zeros(size, np.uint64) for _ in self._windows]
        for signal, raw in zip(self._signals, raws, strict=True):
            bits = signal.to_bits(raw, self.name)
            for p in signal.pieces:
                words[p.word] |= ((bits >> p.up) << p.right) >> p.left
        payloads = np.zeros((size, max(self.length, WORD_BYTES)), np.uint8)
        for (start, order), word in zip(self._windows, words, strict=True):
            octets = word.astype(order).view(np.uint8).reshape(size, WORD_BYTES)
            payloads[:, start : start + WORD_BYTES] |= octets
        return payloads[:, : self.length]


class Database:
    """The messages of a DBC file, each compiled when first asked for.

    Parameters
    ----------
    parsed:
        What cantools parsed.
    where:
        The file, for error messages.
    """

    def __init__(self, parsed: ParsedDatabase, where: object = "database") -> None:
        self._where = where
        self._parsed: dict[str | int, ParsedMessage] = {}
        for message in parsed.messages:
            identifier = message.frame_id | (EXTENDED_ID if message.is_extended_frame else 0)
            self._parsed[message.name] = self._parsed[identifier] = message
        self._compiled: dict[str, MessageCodec] = {}

    def message(self, name_or_id: str | int) -> MessageCodec:
        """Return the codec of a message.

        Parameters
        ----------
        name_or_id:
            Its name, or its identifier (29-bit ones with bit 31 set, as in the DBC file).

        Raises
        ------
        DatabaseError
            If the database lacks it, or it cannot be compiled (see ``MessageCodec``).
        """
        try:
            parsed = self._parsed[name_or_id]
        except KeyError:
            wanted = name_or_id if isinstance(name_or_id, str) else f"0x{name_or_id:X}"
            raise DatabaseError(self._where, f"has no message {wanted}") from None
        if parsed.name not in self._compiled:
            self._compiled[parsed.name] = MessageCodec(parsed)
        return self._compiled[parsed.name]


def load_database(path: str | PathLike[str]) -> Database:
    """Read a DBC file.

    Raises
    ------
    DatabaseError
        If the file cannot be read or is not a DBC file.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise DatabaseError(path, error.strerror or "cannot be read", "expected a file") from error
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    try:
        parsed = cantools.database.load_string(text, database_format="dbc")
    except Exception as error:  # a broken file surfaces as whatever the parser tripped over
        raise DatabaseError(path, f"not a DBC file: {error}") from error
    if not isinstance(parsed, ParsedDatabase) or not parsed.messages:
        raise DatabaseError(path, "has no messages", "expected a DBC file")
    return Database(parsed, path)


@cache
def ars408() -> Database:
    """Return the database of the ARS 408-21 that murk ships."""
    return load_database(Path(__file__).with_name("ars408.dbc"))
