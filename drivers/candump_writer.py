"""``CanFrames`` to candump logs."""

from __future__ import annotations

import gzip
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self, cast

import numpy as np
from numpy.typing import NDArray

from dbc.errors import LogError
from drivers.can_frames import CanFrames, FrameFlag

_ERROR_BIT = 0x20000000


def write_candump(path: str | Path, frames: Iterable[CanFrames]) -> int:
    """Write frames as a compact candump log; see ``CandumpWriter``.

    Returns
    -------
    int
        Frames written.

    Raises
    ------
    LogError
        If the file cannot be written.
    ValueError
        If a stamp is negative, which the format cannot say.
    """
    with CandumpWriter(path) as writer:
        for batch in frames:
            writer.write(batch)
        return writer.count


class CandumpWriter:
    """Writes a compact candump log, compressed where ``path`` ends in ``.gz``.

    Stamps get six decimals where all of a batch are whole microseconds, else nine. A transmitted
    frame is marked with ``T``. Use it as a context manager, or ``close`` it.

    Attributes
    ----------
    count:
        Frames written.

    Raises
    ------
    LogError
        If the file cannot be made.
    """

    def __init__(self, path: str | Path) -> None:
        self.count = 0
        self._path = path
        try:
            self._file = self._open()
        except OSError as error:
            raise self._failure(error) from error

    def write(self, frames: CanFrames) -> None:
        """Append frames.

        Raises
        ------
        LogError
            If the file cannot be written.
        ValueError
            If a stamp is negative, which the format cannot say.
        """
        text = _format(frames)
        try:
            self._file.write(text)
        except OSError as error:
            raise self._failure(error) from error
        self.count += len(frames)

    def close(self) -> None:
        """Finish the file; a second time does nothing."""
        try:
            self._file.close()
        except OSError as error:
            raise self._failure(error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _open(self) -> BinaryIO:
        if is_gzip(self._path):
            return cast(BinaryIO, gzip.open(self._path, "wb"))
        return Path(self._path).open("wb")

    def _failure(self, error: OSError) -> LogError:
        return LogError(self._path, f"cannot be written ({reason_of(error)})")


def is_gzip(path: str | Path) -> bool:
    """Tell whether a log is compressed."""
    return Path(path).suffix == ".gz"


def reason_of(error: Exception) -> str:
    """Return what went wrong with a file, in the system's words where it has some."""
    return (isinstance(error, OSError) and error.strerror) or str(error)


def _format(frames: CanFrames) -> bytes:
    if len(frames) and frames.stamp_ns.min() < 0:
        raise ValueError("a candump log cannot say a negative stamp")
    unit_ns, decimals = (1000, 6) if not (frames.stamp_ns % 1000).any() else (1, 9)
    seconds, fractions = np.divmod(frames.stamp_ns, 10**9)
    rows = zip(
        seconds.tolist(),
        (fractions // unit_ns).tolist(),
        frames.can_id.tolist(),
        frames.length.tolist(),
        frames.data,
        frames.flags.tolist(),
        frames.channel.tolist(),
        strict=True,
    )
    return "".join(
        f"({second:010d}.{fraction:0{decimals}d}) {frames.channels[channel]} "
        f"{_format_frame(can_id, length, data, flags)}\n"
        for second, fraction, can_id, length, data, flags, channel in rows
    ).encode()


def _format_frame(can_id: int, length: int, data: NDArray[np.uint8], flags: int) -> str:
    if flags & FrameFlag.ERROR:
        identifier = f"{can_id | _ERROR_BIT:08X}"
    else:
        identifier = f"{can_id:08X}" if flags & FrameFlag.EXTENDED else f"{can_id:03X}"
    payload = data[:length].tobytes().hex().upper()
    if flags & FrameFlag.REMOTE:
        payload = f"R{length or ''}"
    elif flags & FrameFlag.FD:
        switch, error_state = flags & FrameFlag.BIT_RATE_SWITCH, flags & FrameFlag.ERROR_STATE
        payload = f"#{(1 if switch else 0) | (2 if error_state else 0):X}{payload}"
    return f"{identifier}#{payload}" + (" T" if flags & FrameFlag.TRANSMITTED else "")
