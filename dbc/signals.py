"""How one signal, or several at once, are cut out of words and scaled, and put back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from cantools.database.can import Signal as ParsedSignal
from numpy.typing import NDArray

from dbc.errors import InputError

Words = NDArray[np.uint64]
Columns = Mapping[str, NDArray[Any]]

WORD_BITS = 64
FLOAT = {16: np.float16, 32: np.float32, 64: np.float64}
"""Float type by bits."""

_UINT_OF_FLOAT = {16: np.uint16, 32: np.uint32, 64: np.uint64}
_FLOAT64_BITS = 53  # every integer of so many bits is a float64
_REPEATED_UP_TO = 1024
_SIZES_KEPT = 64
_LARGEST = 1e300  # what is scaled to less than this cannot overflow


@dataclass(frozen=True, slots=True)
class Piece:
    """Consecutive bits of a signal inside one word.

    ``(word << left) >> right`` leaves these bits right-aligned; ``up`` is their place in the
    signal.
    """

    word: int
    left: np.uint64
    right: np.uint64
    up: np.uint64


@dataclass(frozen=True, slots=True)
class Signal:
    """How one signal is cut out of the words and scaled."""

    parsed: ParsedSignal
    name: str
    where: str
    pieces: tuple[Piece, ...]
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
        """Whether a block may take it: an unscaled integer or a scaled float of a usual size."""
        if len(self.pieces) > 1 or self.is_float or self.bits > _FLOAT64_BITS:
            return False
        if self.is_integer:
            return self.scale == 1 and self.offset == 0
        return max(map(abs, self.physical_range)) < _LARGEST

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
            return value.astype(_UINT_OF_FLOAT[self.bits]).view(FLOAT[self.bits])
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

    def put(self, values: NDArray[Any], words: list[Words]) -> None:
        """Put physical values into words: undo ``physical`` and ``raw``."""
        self.put_raw(self._to_raw(values), words)

    def put_raw(self, raw: NDArray[Any], words: list[Words]) -> None:
        """Put raw values into words: undo ``raw``."""
        bits = self._bits_of_float(raw) if self.is_float else self._bits_of_integer(raw)
        for piece in self.pieces:
            words[piece.word] |= ((bits >> piece.up) << piece.right) >> piece.left

    def _to_raw(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the nearest raw values, half to even, not yet checked for range."""
        if self.is_integer and values.dtype.kind in "iu":
            # float64 might lose bits: rare enough for cantools' own exact arithmetic
            convert = self.parsed.conversion.numeric_scaled_to_raw
            return np.array([convert(value) for value in values.tolist()], dtype=object)
        with np.errstate(over="ignore", invalid="ignore"):  # the check for range follows
            raw = (values.astype(np.float64) - self.offset) / self.scale
        return raw if self.is_float else np.rint(raw)

    def _bits_of_float(self, raw: NDArray[Any]) -> Words:
        with np.errstate(over="ignore", invalid="ignore"):
            narrow = raw.astype(FLOAT[self.bits])
        self.refuse(np.isinf(narrow) & ~np.isinf(raw), raw)
        return narrow.view(_UINT_OF_FLOAT[self.bits]).astype(np.uint64)

    def _bits_of_integer(self, raw: NDArray[Any]) -> Words:
        low, high = self.raw_range
        # as a float, the largest 64-bit integer is one more
        self.refuse(~((raw >= low) & (raw < high + 1)), raw)
        integers = raw.astype(np.int64 if self.signed else np.uint64).view(np.uint64)
        return integers & np.uint64((1 << self.bits) - 1)

    def refuse(self, bad: NDArray[np.bool_], raw: NDArray[Any]) -> None:
        """Raise InputError where a raw value is bad."""
        if bad.any():
            value = raw[bad].tolist()[0] * self.scale + self.offset
            low, high = sorted(self.physical_range)
            expected = f"a {self.bits}-bit float" if self.is_float else f"{low:.12g} to {high:.12g}"
            raise InputError(self.where, f"{value:.12g} is out of range", expected)


class Block:
    """Ordinary signals of one word, all signed or all not, taken together.

    Attributes
    ----------
    names:
        Of its signals, the unscaled ones first.
    word:
        Index of the word.
    """

    def __init__(self, signals: list[Signal]) -> None:
        def column(values: list[Any]) -> NDArray[Any]:
            return np.array(values)[:, None]

        unscaled = [signal for signal in signals if signal.is_integer]
        scaled = [signal for signal in signals if not signal.is_integer]
        self._signals = unscaled + scaled
        pieces = [signal.pieces[0] for signal in self._signals]
        self.names = [signal.name for signal in self._signals]
        self.word = pieces[0].word
        self._signed = signals[0].signed
        self._left = column([piece.left for piece in pieces])
        self._right = column([piece.right for piece in pieces])
        self._unscaled = len(unscaled)
        self._scale = column([float(signal.scale) for signal in scaled])
        self._offset = column([float(signal.offset) for signal in scaled])
        self._low = column([float(signal.raw_range[0]) for signal in self._signals])
        self._high = column([float(signal.raw_range[1]) for signal in self._signals])
        self._repeated: dict[int, tuple[NDArray[Any], ...]] = {}

    def raw(self, words: list[Words]) -> NDArray[np.int64]:
        """Return the raw values, (signals, N)."""
        word = words[self.word]
        left, right, _, _ = self._factors(len(word))
        bits = word << left
        values: NDArray[np.int64] = bits.view(np.int64)
        if self._signed:
            values >>= right.view(np.int64)
        else:
            bits >>= right
        return values

    def physical(self, words: list[Words]) -> dict[str, NDArray[Any]]:
        """Return the physical values, (N,) a signal, by name."""
        raw = self.raw(words)
        _, _, scale, offset = self._factors(raw.shape[1])
        scaled = raw[self._unscaled :].astype(np.float64)
        scaled *= scale
        scaled += offset
        return dict(zip(self.names, (*raw[: self._unscaled], *scaled), strict=True))

    def _factors(self, size: int) -> tuple[NDArray[Any], ...]:
        """Return left, right, scale and offset, repeated N times where few enough.

        NumPy then runs one loop instead of one a signal: 250 frames take two thirds of the time.
        """
        columns = (self._left, self._right, self._scale, self._offset)
        if size > _REPEATED_UP_TO:
            return columns
        repeated = self._repeated.get(size)
        if repeated is None:
            repeated = tuple(np.repeat(column, size, axis=1) for column in columns)
            if len(self._repeated) == _SIZES_KEPT:
                self._repeated.clear()
            self._repeated[size] = repeated
        return repeated

    def put(self, columns: Columns, words: list[Words]) -> None:
        """Put physical values into words."""
        raw = np.empty((len(self.names), len(words[self.word])))
        for row, name in enumerate(self.names):
            raw[row] = columns[name]
        scaled = raw[self._unscaled :]
        with np.errstate(over="ignore", invalid="ignore"):  # the check for range follows
            scaled -= self._offset
            scaled /= self._scale
        np.rint(raw, out=raw)
        bad = ~((raw >= self._low) & (raw <= self._high))
        if bad.any():
            for signal, wrong, values in zip(self._signals, bad, raw, strict=True):
                signal.refuse(wrong, values)
        bits = raw.astype(np.int64).view(np.uint64)
        bits <<= self._right
        bits >>= self._left
        words[self.word] |= np.bitwise_or.reduce(bits, axis=0)
