"""MCAP files of the ROS 2 profile: one, or a row of them that are split by time or size."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO
from uuid import uuid4

from mcap.writer import CompressionType, Writer
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2.metadata import dump_qos_v8

from dbc.errors import InputError
from drivers.frame import Frame
from drivers.scan import RadarScan
from node.bus.in_process import KEEP_LAST
from node.bus.inbox import Published
from node.bus.messages import RosMessage, info_to_ros, to_ros, typestore
from node.scene import Scene

SUFFIX = ".mcap"
METADATA = "murk"
"""Name of the metadata record that says what ran: see ``docs/recording.md``."""
_WRAP = 1 << 32
"""MCAP counts messages in 32 bits."""

_NO_TIME = QosTime(0, 0)
_LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    deadline=_NO_TIME,
    lifespan=_NO_TIME,
    liveliness=QosLiveliness.SYSTEM_DEFAULT,
    liveliness_lease_duration=_NO_TIME,
    avoid_ros_namespace_conventions=False,
)
"""What the topics have over DDS, so that a player of the file offers the same."""
_SENSOR_DATA = _LATCHED._replace(
    depth=KEEP_LAST, reliability=QosReliability.BEST_EFFORT, durability=QosDurability.VOLATILE
)


def part_path(path: Path, part: int) -> Path:
    """Return the path of a recording's part; part 0 has the recording's own."""
    return path.with_name(f"{path.stem}_{part}{path.suffix}") if part else path


class McapWriter:
    """Writes murk's messages; every file can be read without the others.

    Parameters
    ----------
    scene:
        What runs; its ``outputs.record`` says where to write.

    Attributes
    ----------
    messages, parts:
        MCAP messages and files written so far.

    Raises
    ------
    InputError
        If the path is taken or cannot be written.
    """

    def __init__(self, scene: Scene) -> None:
        settings = scene.outputs.record
        assert settings is not None, "the caller looked whether the scene asks for it"
        self.messages = self.parts = self._first_ns = 0
        self._settings = settings
        self._store = typestore()
        self._about = {
            "version": version("murk"),
            "recording": uuid4().hex,
            "scene": scene.model_dump_json(exclude={"outputs"}, exclude_defaults=True),
        }
        _check_path(settings.path)
        try:
            self._begin()
        except OSError as error:
            what = f"cannot be recorded to: {error.strerror}"
            raise InputError(settings.path, what, "choose another place") from None

    def write(self, published: Published) -> None:
        """Add a message, and what it carries beside it, to the chunk in progress.

        Raises
        ------
        OSError
            If the disk does not take it.
        """
        if self._is_full(published.time_ns):
            self.close()
            self._begin()
        message = published.message
        if isinstance(message, Frame | RadarScan):
            self._add(f"{published.topic}_info", info_to_ros(message, self._store), published)
        self._add(published.topic, self._to_ros(message), published)

    def _to_ros(self, message: Any) -> RosMessage:
        if not isinstance(message, Frame):
            return to_ros(message, self._store)
        from node.bus.recorded_image import RAW, image_cdr

        return RosMessage(RAW, image_cdr(message, RAW, self._store))

    def _add(self, topic: str, ros: RosMessage, published: Published) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            schema = self._schemas.get(ros.type_name) or self._register(ros.type_name)
            qos = _SENSOR_DATA if isinstance(published.message, Frame | RadarScan) else _LATCHED
            channel = self._channels[topic] = self._writer.register_channel(
                topic, "cdr", schema, {"offered_qos_profiles": dump_qos_v8([qos])}
            )
        count = self._counts[topic] = self._counts.get(topic, -1) + 1
        message = published.message
        self._writer.add_message(
            channel,
            log_time=published.time_ns,
            publish_time=max(0, message.stamp_ns),
            sequence=getattr(message, "sequence", count) % _WRAP,
            data=ros.cdr,
        )
        self.messages += 1
        self._first_ns = self._first_ns or published.time_ns

    def _register(self, type_name: str) -> int:
        text, _ = self._store.generate_msgdef(type_name, ros_version=2)
        schema: int = self._writer.register_schema(type_name, "ros2msg", text.encode())
        self._schemas[type_name] = schema
        return schema

    def flush(self) -> None:
        """Bring everything onto the disk, so that it survives whatever comes.

        Raises
        ------
        OSError
            If the disk does not take it.
        """
        self._writer.flush()  # type: ignore[no-untyped-call]
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Write the summary and close the file.

        Raises
        ------
        OSError
            If the disk does not take it.
        """
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()

    def abandon(self) -> None:
        """Close the file as it is, without a summary; whoever reads it copes."""
        with suppress(OSError):
            self._file.close()

    def _is_full(self, time_ns: int) -> bool:
        split_s, split_mb = self._settings.split_s, self._settings.split_mb
        if split_s is not None and self._first_ns and time_ns - self._first_ns >= split_s * 1e9:
            return True
        return split_mb is not None and self._file.tell() >= split_mb * 1e6

    def _begin(self) -> None:
        path = part_path(self._settings.path, self.parts)
        self._file: BinaryIO = path.open("xb")
        # Images come fast: LZ4 takes a third of zstd's time for them, and two fifths more bytes.
        images = self._settings.images
        compression = CompressionType.LZ4 if images else CompressionType.ZSTD
        self._writer = Writer(self._file, compression=compression)
        try:
            self._writer.start("ros2", library=f"murk {self._about['version']}")
            self._writer.add_metadata(METADATA, {**self._about, "part": str(self.parts)})
            self._file.flush()
        except OSError:
            self.abandon()
            path.unlink()
            raise
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._first_ns = 0
        self.parts += 1


def _check_path(path: Path) -> None:
    """Refuse a name that is none of MCAP's, and one under which something would be overwritten."""
    if path.suffix != SUFFIX:
        raise InputError(path, "is no name of an MCAP file", f"give one that ends in {SUFFIX}")
    part = re.compile(re.escape(path.stem) + r"(_\d+)?" + re.escape(SUFFIX))
    try:
        taken = sorted(one for one in path.parent.iterdir() if part.fullmatch(one.name))
    except OSError:
        return  # opening it tells why
    if taken:
        raise InputError(taken[0], "exists, and is not overwritten", "choose another name")
