"""Decode and encode many payloads of one CAN message at once, as a DBC file describes it.

cantools reads the DBC file. Each message is then compiled to a plan: a signal is one piece of an
eight-byte word (two pieces where it touches nine bytes), reached by two shifts, and becomes
physical by one multiplication and one addition. Both are done for all payloads, and for all
ordinary signals of a word, at once.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import cache
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
from dbc.signals import FLOAT, WORD_BITS, Block, Piece, Signal, Words

Payloads = NDArray[np.uint8]

WORD_BYTES = 8
_BIG_ENDIAN, _LITTLE_ENDIAN = np.dtype(">u8"), np.dtype("<u8")
_NATIVE = np.dtype(np.uint64)
EXTENDED_ID = 1 << 31
"""How a DBC file marks a 29-bit identifier."""


class MessageCodec:
    """One message of a DBC file, compiled.

    Parameters
    ----------
    message:
        What cantools parsed.

    Raises
    ------
    DatabaseError
        If the message is multiplexed, has a signal that starts before bit 0 or has over 64 bits,
        a float of other than 16, 32 or 64 bits, or a scale of 0.

    Attributes
    ----------
    name, id, length:
        The message's name, frame identifier and payload bytes.
    signals:
        Names of its signals.
    choices:
        Names of the values that the file names, by signal and value.
    """

    def __init__(self, message: ParsedMessage) -> None:
        self.name: str = message.name
        self.id: int = message.frame_id
        self.length: int = message.length
        if message.is_multiplexed():
            raise DatabaseError(self.name, "is multiplexed", "decode it frame by frame")
        self._windows: list[tuple[slice, np.dtype[np.uint64]]] = []
        self._signals = [self._compile(signal) for signal in message.signals]
        self.signals: tuple[str, ...] = tuple(signal.name for signal in self._signals)
        self.choices: dict[str, dict[int, str]] = {
            signal.name: {int(value): str(name) for value, name in signal.choices.items()}
            for signal in message.signals
            if signal.choices
        }
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
            columns |= block.physical(words)
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
            Signal name → (N,) array or scalar, for every signal of the message; scalars alone
            give one payload.

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
        columns, words = self._prepare(values)
        for block in self._blocks:
            block.put(columns, words)
        for signal in self._others:
            signal.put(columns[signal.name], words)
        return self._payloads(words)

    def encode_raw(self, values: Mapping[str, ArrayLike]) -> Payloads:
        """Return payloads that carry raw values; otherwise as ``encode``."""
        columns, words = self._prepare(values)
        for signal in self._signals:
            signal.put_raw(columns[signal.name], words)
        return self._payloads(words)

    def _compile(self, signal: ParsedSignal) -> Signal:
        bits = signal.length
        is_float = bool(signal.is_float)
        scale, offset = signal.scale, signal.offset
        where = f"{self.name}.{signal.name}"
        if signal.start < 0:
            raise DatabaseError(where, f"starts at bit {signal.start}", "expected 0 or more")
        if bits > WORD_BITS:
            raise DatabaseError(where, f"has {bits} bits", f"up to {WORD_BITS} can be decoded")
        if is_float and bits not in FLOAT:
            raise DatabaseError(where, f"is a {bits}-bit float", "expected 16, 32 or 64 bits")
        if scale == 0 or max(abs(scale), abs(offset)) > sys.float_info.max:
            raise DatabaseError(where, f"has scale {scale}, offset {offset}", "expected numbers")
        if float(scale).is_integer() and float(offset).is_integer():
            scale, offset = int(scale), int(offset)
        return Signal(
            parsed=signal,
            name=signal.name,
            where=where,
            pieces=self._pieces(signal),
            bits=bits,
            signed=bool(signal.is_signed) and not is_float,
            is_float=is_float,
            scale=scale,
            offset=offset,
        )

    def _gather(self) -> list[Block]:
        groups: dict[tuple[int, bool], list[Signal]] = {}
        for signal in self._signals:
            if signal.is_ordinary:
                groups.setdefault((signal.pieces[0].word, signal.signed), []).append(signal)
        return [Block(group) for group in groups.values()]

    def _pieces(self, signal: ParsedSignal) -> tuple[Piece, ...]:
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

    def _piece(self, big: bool, byte: int, skipped: int, bits: int, up: int) -> Piece:
        start = max(0, min(byte, self.length - WORD_BYTES))
        skipped += 8 * (byte - start)
        window = (slice(start, start + WORD_BYTES), _BIG_ENDIAN if big else _LITTLE_ENDIAN)
        if window not in self._windows:
            self._windows.append(window)
        return Piece(
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
            payloads[:, octets].view(order).ravel().astype(_NATIVE)
            for octets, order in self._windows
        ]

    def _prepare(
        self, values: Mapping[str, ArrayLike]
    ) -> tuple[dict[str, NDArray[Any]], list[Words]]:
        """Return values as columns of one length, and as many empty words."""
        for name in self.signals:
            if name not in values:
                raise InputError(f"{self.name}.{name}", "has no value", "every signal needs one")
        columns = {name: np.asarray(value) for name, value in values.items()}
        for name, column in columns.items():
            if name not in self.signals:
                raise InputError(f"{self.name}.{name}", "is not a signal of this message")
            if column.ndim > 1 or column.dtype.kind not in "biuf":
                raise InputError(f"{self.name}.{name}", "is not a column of numbers")
        sizes = {len(column) for column in columns.values() if column.ndim} or {1}
        if len(sizes) > 1:
            raise InputError(self.name, f"columns of {sorted(sizes)} values", "expected one N")
        (size,) = sizes
        columns = {
            name: column if column.ndim else np.full(size, column)
            for name, column in columns.items()
        }
        return columns, [np.zeros(size, np.uint64) for _ in self._windows]

    def _payloads(self, words: list[Words]) -> Payloads:
        size = len(words[0]) if words else 0
        payloads = np.zeros((size, max(self.length, WORD_BYTES)), np.uint8)
        for (octets, order), word in zip(self._windows, words, strict=True):
            payloads[:, octets] |= word.astype(order).view(np.uint8).reshape(size, WORD_BYTES)
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


@cache
def noise_level() -> MessageCodec:
    """Return the message that carries a noise level, as the DBC file that murk ships has it."""
    return load_database(Path(__file__).with_name("noise_level.dbc")).message("NoiseLevel")
