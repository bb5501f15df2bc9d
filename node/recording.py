"""MCAP recordings as sources: murk's own, bit for bit, and the camera topics of ROS 2's."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dbc.errors import InputError, SceneError
from drivers.frame import Frame
from drivers.scan import RadarScan

if TYPE_CHECKING:
    from node.bus.mcap_reader import Entry, McapRecording
    from node.scene import Sensor, SensorType

_SUFFIX = ".mcap"
_ESTIMATION = ("calibration", "adaptive")
"""Fields of a sensor that decide how it is estimated."""
_LEVEL = "murk_msgs/msg/NoiseLevel"
_SCAN = "sensor_msgs/msg/PointCloud2"
_INFOS = ("murk_msgs/msg/RadarScanInfo", "murk_msgs/msg/FrameInfo")
_IMAGES = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image")


def is_recording(source: str) -> bool:
    """Tell an MCAP recording, ``drive.mcap`` or ``drive.mcap:/topic``, from other sources."""
    return source.endswith(_SUFFIX) or f"{_SUFFIX}:/" in source


def split_source(source: str) -> tuple[Path, str | None]:
    """Return a recording's path, and the topic that its source names."""
    path, colon, topic = source.partition(f"{_SUFFIX}:/")
    return (Path(path + _SUFFIX), f"/{topic}") if colon else (Path(source), None)


def sensor_topics(recording: McapRecording) -> dict[str, SensorType]:
    """Return the topics that can be a sensor's source; of clouds only those that murk wrote."""
    topics: dict[str, SensorType] = {}
    for topic, type_name in recording.topics.items():
        if type_name in _IMAGES:
            topics[topic] = "camera"
        elif type_name == _SCAN and info_topic(recording, topic) is not None:
            topics[topic] = "radar"
    return topics


def info_topic(recording: McapRecording, topic: str) -> str | None:
    """Return the topic of what murk recorded beside a topic's scans or frames; None: it did not."""
    beside = f"{topic}_info"
    return beside if recording.topics.get(beside) in _INFOS else None


def level_topic(topic: str) -> str:
    """Return the topic of the noise levels that were published for a topic's scans or frames."""
    return re.sub("/(scan|image)$", "", topic) + "/noise_level"


def decode(entry: Entry, info: bytes | None, count: int, path: Path) -> Any:
    """Return murk's message of an entry, or the frame of another program's image.

    Parameters
    ----------
    info:
        CDR of what was recorded beside it, where it was.
    count:
        How many came before it: the sequence of another program's image.
    path:
        Of the recording, for errors.

    Raises
    ------
    InputError
        If the bytes are malformed, or an image's format or encoding is not read.
    """
    from node.bus.messages import from_ros, typestore

    try:
        if entry.type_name in _IMAGES:
            from node.bus.recorded_image import read_image

            frame = read_image(entry.type_name, entry.cdr, info, count, typestore())
            return replace(frame, stamp_ns=frame.stamp_ns or entry.publish_time)
        return from_ros(entry.type_name, entry.cdr, typestore(), info)
    except InputError as error:
        raise InputError(f"{path}:{entry.topic}", error.what, error.remedy) from None


def read_recording(path: Path) -> dict[str, Any]:
    """Return the content of a scene that replays a recording: a sensor a topic, nothing injected.

    A sensor is estimated as it was: calibrated by the same file, adaptively or not.

    Raises
    ------
    InputError
        If the file is no MCAP recording, or holds the data of no sensor.
    """
    from node.bus.mcap_reader import open_mcap

    recording = open_mcap(path)
    topics = sensor_topics(recording)
    if not topics:
        what = "holds no sensor's data to replay"
        raise InputError(path, what, "record with scans or images in [outputs.record]")
    try:
        about = json.loads(recording.about.get("scene", "{}"))
        recorded = {one["name"]: one.items() for one in about.get("sensors", ())}
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputError(path, "is damaged: what it says of its scene cannot be read") from None
    sensors = []
    for topic, sensor_type in topics.items():
        name = sensor_name(topic)
        sensor = {"name": name, "type": sensor_type, "source": f"{path}:{topic}"}
        how = {key: value for key, value in recorded.get(name, ()) if key in _ESTIMATION}
        sensors.append(sensor | how)
    return {**{key: about[key] for key in ("name", "seed") if key in about}, "sensors": sensors}


def open_sensors(path: Path) -> list[tuple[Sensor, RecordingSource]]:
    """Open every sensor of a recording.

    Raises
    ------
    InputError
        If the file is no MCAP recording, or holds the data of no sensor.
    """
    from node.scene import Sensor

    sensors = [Sensor.model_validate(content) for content in read_recording(path)["sensors"]]
    return [(sensor, RecordingSource(sensor)) for sensor in sensors]


def sensor_name(topic: str) -> str:
    """Return a sensor's name for a topic: ``front`` for ``/murk/front/scan``."""
    own = re.fullmatch(r"/murk/([a-z][a-z0-9_]*)/(scan|image)", topic)
    name = own[1] if own else re.sub(r"[^a-z0-9]+", "_", topic.lower()).strip("_")
    return name if name[:1].isalpha() else f"topic_{name}"


class RecordingSource:
    """One sensor's frames or scans in a recording, with what was injected when it was made.

    Raises
    ------
    InputError
        If the file is no MCAP recording.
    SceneError
        If it is not clear which topic the sensor's is.
    """

    live = False

    def __init__(self, sensor: Sensor) -> None:
        from node.bus.mcap_reader import open_mcap

        path, topic = split_source(sensor.source)
        self._sensor = sensor
        self._path = path
        self._recording = open_mcap(path)
        self._topic = _choose(sensor, path, topic, sensor_topics(self._recording))
        levels = level_topic(self._topic)
        self._level_topic = levels if self._recording.topics.get(levels) == _LEVEL else None

    def messages(self) -> Iterator[Frame | RadarScan]:
        """Yield frames or scans; see ``Source``."""
        waiting: Frame | RadarScan | None = None
        came = False
        for message in self._decoded():
            if isinstance(message, Frame | RadarScan):
                if waiting is not None:
                    yield waiting
                waiting, came = replace(message, sensor=self._sensor.name), True
            elif waiting is not None and message.sequence == waiting.sequence:
                yield replace(
                    waiting, injected=message.injected, drawn=message.drawn, dropped=message.dropped
                )
                waiting = None
        if waiting is not None:
            yield waiting
        if not came:
            raise InputError(self._path, f"holds nothing on {self._topic}", "was it cut off?")

    def close(self) -> None:
        """Nothing stays open between reads."""

    def _decoded(self) -> Iterator[Any]:
        """Yield frames or scans, and after each the noise level that was published for it."""
        beside = info_topic(self._recording, self._topic)
        info: bytes | None = None
        count = 0
        topics = (self._topic, self._level_topic, beside)
        for entry in self._recording.entries({topic for topic in topics if topic is not None}):
            if entry.topic == beside:
                info = entry.cdr
            else:
                yield decode(entry, info, count, self._path)
                count += entry.topic == self._topic


def _choose(sensor: Sensor, path: Path, topic: str | None, topics: dict[str, SensorType]) -> str:
    """Return the topic that is named, or the sensor's own, or the only one of its type."""
    fitting = [name for name, sensor_type in topics.items() if sensor_type == sensor.type]
    if topic is not None:
        candidates = [name for name in fitting if name == topic]
    else:
        candidates = [name for name in fitting if sensor_name(name) == sensor.name] or fitting
    if len(candidates) == 1:
        return candidates[0]
    if not fitting:
        what = f"holds no {sensor.type}'s data"
        raise InputError(path, what, "record with scans or images in [outputs.record]")
    what = f"has no topic {topic}" if topic else f"has {len(fitting)} topics of a {sensor.type}"
    named = ", ".join(f"{path}:{name}" for name in fitting)
    raise SceneError(path, f"{what} that '{sensor.name}' could be", f"give one of {named}")
