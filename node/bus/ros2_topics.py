"""Which topic of the bus becomes which topics of ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

from drivers.frame import Frame
from drivers.scan import RadarScan
from models.estimate.level import NoiseLevel
from node.bus.dds import LATCHED, SENSOR_DATA
from node.bus.messages import RosMessage, info_to_ros, to_ros, type_name_of, typestore
from node.events import EVENT_TOPIC, MODEL_TOPIC, STATE_TOPIC, ModelChoice, NodeEvent, NodeState
from node.health import SensorEvent
from node.scene import Ros2Settings, Sensor


class Carried(NamedTuple):
    """A topic of the bus, and one of ROS 2 on which its messages are sent on."""

    source: str
    topic: str
    type_name: str
    qos: Any
    serialize: Callable[[Any], RosMessage]


def level_topics(sensors: tuple[Sensor, ...]) -> Iterator[Carried]:
    """Yield what is small and latched: levels, events, states and choices."""
    for sensor in sensors:
        yield _latched(f"/murk/{sensor.name}/noise_level", NoiseLevel)
        yield _latched(f"/murk/{sensor.name}/event", SensorEvent)
    yield _latched(STATE_TOPIC, NodeState)
    yield _latched(EVENT_TOPIC, NodeEvent)
    yield _latched(MODEL_TOPIC, ModelChoice)


def data_topics(sensors: tuple[Sensor, ...], settings: Ros2Settings) -> Iterator[Carried]:
    """Yield what is large: the scans and images that the scene asks for, as degraded."""
    for sensor in sensors:
        base = f"/murk/{sensor.name}"
        if sensor.type == "radar" and settings.scans:
            info = "murk_msgs/msg/RadarScanInfo"
            yield _data(f"{base}/scan", f"{base}/scan", type_name_of(RadarScan), to_ros)
            yield _data(f"{base}/scan", f"{base}/scan_info", info, info_to_ros)
        if sensor.type == "camera" and settings.images:
            info = "murk_msgs/msg/FrameInfo"
            yield _data(f"{base}/image", f"{base}/image/compressed", type_name_of(Frame), to_ros)
            yield _data(f"{base}/image", f"{base}/image_info", info, info_to_ros)


def _latched(topic: str, message_type: type) -> Carried:
    serialize = partial(to_ros, store=typestore())
    return Carried(topic, topic, type_name_of(message_type), LATCHED, serialize)


def _data(source: str, topic: str, type_name: str, serialize: Callable[..., RosMessage]) -> Carried:
    return Carried(source, topic, type_name, SENSOR_DATA, partial(serialize, store=typestore()))
