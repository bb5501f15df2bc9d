"""A copy of an MCAP file in which some messages are others."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import Writer

from node.bus.mcap_reader import read_records

Change = Callable[[str, str, Message], Iterable[Message]]
"""Takes topic, type name and message; returns what is written in its place."""


def copy_mcap(source: Path, target: Path, change: Change) -> None:
    """Write a copy, each message as ``change`` has it, all else as it was.

    Raises
    ------
    InputError
        If the source is damaged.
    OSError
        If the target cannot be written.
    """
    schemas: dict[int, tuple[int, str]] = {0: (0, "")}
    channels: dict[int, tuple[int, str, str]] = {}
    with target.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", library="murk")
        for record in read_records(source):
            if isinstance(record, Schema) and record.id not in schemas:
                number = writer.register_schema(record.name, record.encoding, record.data)
                schemas[record.id] = number, record.name
            elif isinstance(record, Channel) and record.id not in channels:
                schema, type_name = schemas.get(record.schema_id, schemas[0])
                number = writer.register_channel(
                    record.topic, record.message_encoding, schema, record.metadata
                )
                channels[record.id] = number, record.topic, type_name
            elif isinstance(record, Message) and record.channel_id in channels:
                _, topic, type_name = channels[record.channel_id]
                for message in change(topic, type_name, record):
                    writer.add_message(
                        channels[message.channel_id][0],
                        log_time=message.log_time,
                        publish_time=message.publish_time,
                        sequence=message.sequence,
                        data=message.data,
                    )
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
            elif isinstance(record, Attachment):
                writer.add_attachment(
                    record.create_time, record.log_time, record.name, record.media_type, record.data
                )
        writer.finish()  # type: ignore[no-untyped-call]
