"""MCAP files as they come: whole, cut off by a kill or a full disk, damaged, or none at all."""

from __future__ import annotations

import logging
import struct
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import zstandard
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.reader import make_reader
from mcap.records import Channel, DataEnd, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

from dbc.errors import InputError
from node.bus.mcap_writer import METADATA, part_path

log = logging.getLogger("murk.recording")

_DAMAGE = (
    McapError,
    struct.error,
    ValueError,
    KeyError,
    RuntimeError,
    OverflowError,
    MemoryError,
    zstandard.ZstdError,
)
"""What the library lets through where the bytes are not what they should be."""


class Entry(NamedTuple):
    """One message: where it stood, what it is, and its CDR bytes; times in nanoseconds."""

    topic: str
    type_name: str
    log_time: int
    publish_time: int
    sequence: int
    cdr: bytes


@dataclass(frozen=True, slots=True)
class McapRecording:
    """An MCAP file with the parts that follow it.

    Attributes
    ----------
    paths:
        The file that was asked for, and the parts that it was split into after it.
    about:
        What murk wrote about the run; empty where another wrote the file.
    topics:
        Name of the message type by topic, of all messages in CDR.
    """

    paths: tuple[Path, ...]
    about: Mapping[str, str]
    topics: Mapping[str, str]

    def entries(self, topics: Collection[str] | None = None) -> Iterator[Entry]:
        """Yield messages in the order of the file; of all topics where none are given.

        Raises
        ------
        InputError
            At damage; what came before has been yielded. A file that just ends is none.
        """
        for path in self.paths:
            yield from _entries(path, topics)


def open_mcap(path: Path) -> McapRecording:
    """Look what an MCAP file holds.

    Raises
    ------
    InputError
        If the file is missing, is not MCAP, or holds no message.
    """
    about = _about(path)
    paths = (path, *_parts_after(path, about))
    topics: dict[str, str] = {}
    for one in paths:
        topics |= _topics(one)
    if not topics:
        raise InputError(path, "holds no message in CDR", "expected a recording of ROS 2 or murk")
    return McapRecording(paths, about, topics)


def _about(path: Path) -> dict[str, str]:
    """Return what murk wrote at the file's beginning; empty where another program wrote it."""
    try:
        with path.open("rb") as file:
            for record in _records(file, path, emit_chunks=True):
                if isinstance(record, Metadata) and record.name == METADATA:
                    return dict(record.metadata)
                if not isinstance(record, Header | Metadata):
                    break
    except OSError as error:
        what = (error.strerror or "cannot be read").lower()
        raise InputError(path, what, "expected an MCAP file") from None
    except InvalidMagic:
        raise InputError(path, "is not MCAP", "expected a recording of murk or ROS 2") from None
    except _DAMAGE:
        what = "is empty" if not path.stat().st_size else "ends or is damaged at its beginning"
        raise InputError(path, what, "expected an MCAP file") from None
    return {}


def _parts_after(path: Path, about: Mapping[str, str]) -> Iterator[Path]:
    """Yield the files into which the recording was split after this one."""
    if not about.get("part", "").isdecimal():
        return
    own = int(about["part"])
    first = path.with_name(path.name.removesuffix(f"_{own}{path.suffix}") + path.suffix)
    for part in count(own + 1):
        following = part_path(first if own else path, part)
        if not following.exists():
            return
        if _about(following).get("recording") != about.get("recording"):
            return
        yield following


def _topics(path: Path) -> dict[str, str]:
    """Return the types by topic: from the summary, or where there is none from all records."""
    with path.open("rb") as file:
        try:
            summary = make_reader(file).get_summary()
        except _DAMAGE:
            summary = None
        if summary is not None and summary.channels:
            channels, schemas = summary.channels, summary.schemas
        else:
            file.seek(0)
            channels, schemas = _scanned(file, path)
    return {
        channel.topic: schemas[channel.schema_id].name
        for channel in channels.values()
        if channel.message_encoding == "cdr" and channel.schema_id in schemas
    }


def _scanned(file: BinaryIO, path: Path) -> tuple[dict[int, Channel], dict[int, Schema]]:
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    try:
        for record in _records(file, path):
            if isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Schema):
                schemas[record.id] = record
    except _DAMAGE:
        pass  # told by whoever reads the messages
    return channels, schemas


def _entries(path: Path, topics: Collection[str] | None) -> Iterator[Entry]:
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    for record in read_records(path):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message) and record.channel_id in channels:
            channel = channels[record.channel_id]
            if channel.schema_id in schemas and (topics is None or channel.topic in topics):
                yield _entry(record, channel, schemas[channel.schema_id])


def read_records(path: Path) -> Iterator[Any]:
    """Yield the records of the data section as the library has them, out of their chunks.

    Raises
    ------
    InputError
        At damage; what came before has been yielded. A file that just ends is none.
    """
    messages = 0
    with path.open("rb") as file:
        try:
            for record in _records(file, path):
                if isinstance(record, DataEnd):
                    return
                messages += isinstance(record, Message)
                yield record
        except EndOfFile:
            log.warning("%s was cut off; its first %d messages are read", path, messages)
        except _DAMAGE as error:
            cause = str(error) or type(error).__name__
            what = f"is damaged after {messages} messages: {cause}"
            raise InputError(path, what, "'mcap recover' saves what follows") from None


def _entry(message: Message, channel: Channel, schema: Schema) -> Entry:
    return Entry(
        channel.topic,
        schema.name,
        message.log_time,
        message.publish_time,
        message.sequence,
        message.data,
    )


def _records(file: BinaryIO, path: Path, *, emit_chunks: bool = False) -> Iterator[Any]:
    whole: Any = _Whole(file)
    limit = path.stat().st_size  # no record is longer, whatever damaged bytes say
    return StreamReader(
        whole, emit_chunks=emit_chunks, validate_crcs=True, record_size_limit=limit
    ).records


class _Whole:
    """A stream that tells when it ends within what was asked for; the library reads on."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def read(self, length: int) -> bytes:
        data = self._file.read(length)
        if len(data) < length:
            raise EndOfFile
        return data
