"""CAN logs of any format: candump text by our own reader, the rest by python-can."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dbc.errors import LogError
from drivers.can_frames import CanFrames
from drivers.candump import read_candump

if TYPE_CHECKING:
    from can import Message

CANDUMP_SUFFIXES = (".log", ".txt", ".candump")
PYTHON_CAN_SUFFIXES = (".asc", ".blf", ".csv", ".db", ".mf4", ".trc")
_BATCH = 4096
_LATEST_STAMP_S = 2**63 / 1e9


def read_log(path: str | Path, chunk_bytes: int = 1 << 18) -> Iterator[CanFrames]:
    """Read a CAN log in batches of constant memory; its format is told by the suffix.

    candump text (``.log``, ``.txt``, ``.candump``) is read by ``drivers.candump``, anything else by
    python-can: its stamps are exact to the microsecond and begin where the format has them begin
    (``.asc``: at 0). ``.gz`` may follow any suffix but ``.db`` and ``.mf4``.

    Parameters
    ----------
    path:
        The log.
    chunk_bytes:
        Bytes of candump text read at once: less for a shorter pause, more for speed.

    Raises
    ------
    LogError
        If the suffix is unknown, a library for it is not installed, or the file cannot be opened,
        holds no frame or holds something else; what comes before is yielded first.
    """
    path = Path(path)
    suffix = (Path(path.stem).suffix if path.suffix == ".gz" else path.suffix).lower()
    if suffix in CANDUMP_SUFFIXES:
        yield from read_candump(path, chunk_bytes)
    elif suffix in PYTHON_CAN_SUFFIXES:
        yield from _read_by_python_can(path)
    else:
        known = ", ".join(CANDUMP_SUFFIXES + PYTHON_CAN_SUFFIXES)
        raise LogError(path, f"unknown kind of log {suffix!r}", f"known are {known}")


def _read_by_python_can(path: Path) -> Iterator[CanFrames]:
    from drivers.can_messages import from_messages

    channels: dict[str, int] = {}
    failures: list[Exception] = []
    messages = _messages(path, failures)
    count = 0
    while batch := list(islice(messages, _BATCH)):
        channel = [channels.setdefault(_name(message), len(channels)) for message in batch]
        if len(channels) > 256:
            raise LogError(path, "names more than 256 CAN interfaces")
        count += len(batch)
        yield from_messages(batch, tuple(channels), np.array(channel, np.uint8))
    if failures:
        place = path if not count else f"{path}, after frame {count}"
        what = f"cannot be read as {path.suffix} ({failures[0]})"
        raise LogError(place, what, _remedy(failures[0])) from failures[0]
    if not count:
        raise LogError(path, "holds no CAN frame", f"expected a {path.suffix} log")


def _messages(path: Path, failures: list[Exception]) -> Iterator[Message]:
    """Yield python-can's messages up to the first failure, which is added to ``failures``."""
    import can

    try:
        path.open("rb").close()  # python-can would make a new .db where there is none
        with can.LogReader(path) as reader:
            for message in reader:
                _check(message)
                yield message
    except Exception as error:  # python-can's readers raise anything on wrong content
        failures.append(error)


def _check(message: Message) -> None:
    limit = 64 if message.is_fd else 8
    if not 0 <= message.dlc <= limit or len(message.data) > limit:
        raise ValueError(f"a frame of {max(message.dlc, len(message.data))} bytes")
    if not 0 <= message.arbitration_id <= (0x1FFFFFFF if message.is_extended_id else 0x7FF):
        raise ValueError(f"the ID {message.arbitration_id:X}")
    if not 0 <= message.timestamp < _LATEST_STAMP_S:
        raise ValueError(f"the stamp {message.timestamp}")


def _name(message: Message) -> str:
    channel = 0 if message.channel is None else message.channel
    return f"can{channel}" if isinstance(channel, int) else str(channel)


def _remedy(error: Exception) -> str:
    if isinstance(error, NotImplementedError | ImportError):
        return "install the library that python-can needs for it, or convert the log to .blf"
    return "give a log of the kind that its suffix says"
