"""murk's messages as ROS 2 messages and back; the ``.msg`` files in ``murk_msgs`` are the truth.

Bytes are CDR as ROS 2 has it: little-endian XCDR1 behind an encapsulation header of four bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from dbc.errors import InputError
from drivers.frame import Frame
from drivers.scan import RadarScan
from models.estimate.level import NoiseLevel
from node.bus.scan_message import (
    cloud_message,
    drawn_of,
    injected_fields,
    injected_of,
    parse_scan,
    ros_time,
    scan_info_message,
    time_ns_of,
)
from node.events import ModelChoice, NodeEvent, NodeState
from node.health import SensorEvent

PACKAGE = Path(__file__).with_name("murk_msgs")
"""The ROS 2 interface package."""


class RosMessage(NamedTuple):
    """A serialised message: name of its ROS type, e.g. ``murk_msgs/msg/NoiseLevel``, and CDR."""

    type_name: str
    cdr: bytes


@dataclass(frozen=True, slots=True)
class InjectionRequest:
    """A wish to change what is injected; a ``level`` of None gives back to the schedule."""

    kind: str
    level: float | None


@cache
def typestore() -> Typestore:
    """Return the types of ROS 2 Humble and those of ``murk_msgs``; the same one at every call."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    for path in sorted(PACKAGE.glob("msg/*.msg")):
        text = path.read_text(encoding="utf-8")
        store.register(get_types_from_msg(text, f"murk_msgs/msg/{path.stem}"))
    return store


def type_name_of(message_type: type) -> str:
    """Return the ROS type's name for a class of murk's messages.

    Raises
    ------
    KeyError
        If ROS has none for it.
    """
    return _FORMS[message_type].type_name


def to_ros(message: Any, store: Typestore, *, lossless: bool = False) -> RosMessage:
    """Serialise a message of murk's.

    Parameters
    ----------
    message:
        ``NoiseLevel``, ``RadarScan`` (becomes a ``PointCloud2``), ``Frame`` (``CompressedImage``),
        ``SensorEvent``, ``ModelChoice``, ``NodeState``, ``NodeEvent`` or ``InjectionRequest``.
        What a scan or frame carries beside its points or pixels is a message of its own,
        see ``info_to_ros``.
    store:
        Of ``typestore``.
    lossless:
        A frame becomes PNG instead of JPEG.

    Raises
    ------
    KeyError
        If ROS has no type for it.
    """
    if lossless and isinstance(message, Frame):
        return serialize(_build_frame(message, store, lossless=True), store)
    return serialize(_FORMS[type(message)].build(message, store), store)


def info_to_ros(message: RadarScan | Frame, store: Typestore) -> RosMessage:
    """Serialise what a scan or frame carries beside its points or pixels."""
    if isinstance(message, RadarScan):
        return serialize(scan_info_message(message, store), store)
    from node.bus.image_message import frame_info_message

    return serialize(frame_info_message(message, store), store)


def from_ros(type_name: str, cdr: bytes, store: Typestore, info: bytes | None = None) -> Any:
    """Rebuild a message of murk's: the inverse of ``to_ros`` (a JPEG's pixels apart).

    Parameters
    ----------
    type_name, cdr:
        Name of the ROS type, and the message.
    info:
        CDR of the ``RadarScanInfo`` or ``FrameInfo`` of the same stamp; a ``PointCloud2`` or
        ``CompressedImage`` needs it.

    Raises
    ------
    InputError
        If the type is none of murk's, or the bytes are malformed.
    """
    parse = _PARSERS.get(type_name)
    if parse is None:
        raise InputError(type_name, "is no message of murk's", f"expected {', '.join(_PARSERS)}")
    messages = [deserialize(type_name, cdr, store)]
    if type_name in _INFO_TYPES:
        if info is None:
            raise InputError(type_name, "came without the information beside it")
        messages.append(deserialize(_INFO_TYPES[type_name], info, store))
    try:
        return parse(*messages)
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(type_name, f"malformed: {error}") from None


def serialize(message: Any, store: Typestore) -> RosMessage:
    """Serialise a ROS message that was built from the type store's classes."""
    type_name: str = message.__msgtype__
    return RosMessage(type_name, bytes(store.serialize_cdr(message, type_name)))


def deserialize(type_name: str, cdr: bytes, store: Typestore) -> Any:
    """Return the ROS message of some CDR bytes.

    Raises
    ------
    InputError
        If the bytes do not hold one.
    """
    try:
        return store.deserialize_cdr(cdr, type_name)
    except Exception as error:  # rosbags lets through whatever reading beyond the end raises
        raise InputError(type_name, f"malformed: {error}") from None


def _build_level(level: NoiseLevel, store: Typestore) -> Any:
    types = store.types
    return types["murk_msgs/msg/NoiseLevel"](
        header=types["std_msgs/msg/Header"](ros_time(level.stamp_ns, store), level.sensor),
        sequence=level.sequence,
        dropped=level.dropped,
        latency_ns=level.latency_ns,
        level=level.level,
        std_dev=level.std,
        probabilities=level.probabilities,
        raw=level.raw,
        effort=level.effort,
        kind=level.kind,
        kinds=list(level.kind_probabilities),
        kind_probabilities=np.array(list(level.kind_probabilities.values()), np.float64),
        **injected_fields(level),
    )


def _parse_level(message: Any) -> NoiseLevel:
    return NoiseLevel(
        sensor=message.header.frame_id,
        stamp_ns=time_ns_of(message.header.stamp),
        level=message.level,
        std=message.std_dev,
        probabilities=message.probabilities,
        kind=message.kind,
        kind_probabilities=dict(
            zip(message.kinds, message.kind_probabilities.tolist(), strict=True)
        ),
        raw=message.raw,
        effort=message.effort,
        injected=injected_of(message),
        drawn=drawn_of(message),
        latency_ns=message.latency_ns,
        sequence=message.sequence,
        dropped=message.dropped,
    )


def _build_sensor_event(event: SensorEvent, store: Typestore) -> Any:
    types = store.types
    header = types["std_msgs/msg/Header"](ros_time(event.stamp_ns, store), event.sensor)
    return types["murk_msgs/msg/SensorEvent"](header, event.state, event.detail)


def _parse_sensor_event(message: Any) -> SensorEvent:
    stamp_ns = time_ns_of(message.header.stamp)
    return SensorEvent(message.header.frame_id, stamp_ns, message.state, message.detail)


def _build_choice(choice: ModelChoice, store: Typestore) -> Any:
    return store.types["murk_msgs/msg/ModelChoice"](
        ros_time(choice.stamp_ns, store),
        choice.switch,
        choice.model,
        choice.previous,
        choice.reason,
    )


def _parse_choice(message: Any) -> ModelChoice:
    stamp_ns = time_ns_of(message.stamp)
    return ModelChoice(
        message.switch_name, stamp_ns, message.model, message.previous, message.reason
    )


def _build_node_state(state: NodeState, store: Typestore) -> Any:
    stamp = ros_time(state.stamp_ns, store)
    return store.types["murk_msgs/msg/NodeState"](stamp, state.node, state.state, state.sequence)


def _parse_node_state(message: Any) -> NodeState:
    return NodeState(message.node, time_ns_of(message.stamp), message.state, message.sequence)


def _build_node_event(event: NodeEvent, store: Typestore) -> Any:
    stamp = ros_time(event.stamp_ns, store)
    return store.types["murk_msgs/msg/NodeEvent"](stamp, event.source, event.detail)


def _parse_node_event(message: Any) -> NodeEvent:
    return NodeEvent(message.source, time_ns_of(message.stamp), message.detail)


def _build_request(request: InjectionRequest, store: Typestore) -> Any:
    scheduled = request.level is None
    return store.types["murk_msgs/msg/Injection"](request.kind, request.level or 0.0, scheduled)


def _parse_request(message: Any) -> InjectionRequest:
    return InjectionRequest(message.kind, None if message.scheduled else message.level)


def _build_frame(frame: Frame, store: Typestore, *, lossless: bool = False) -> Any:
    from node.bus.image_message import image_message

    return image_message(frame, store, lossless=lossless)


def _parse_frame(message: Any, info: Any) -> Frame:
    from node.bus.image_message import parse_frame

    return parse_frame(message, info)


class _Form(NamedTuple):
    """How a class of murk's messages looks in ROS."""

    type_name: str
    build: Callable[[Any, Typestore], Any]
    parse: Callable[..., Any]


_FORMS: dict[type, _Form] = {
    NoiseLevel: _Form("murk_msgs/msg/NoiseLevel", _build_level, _parse_level),
    RadarScan: _Form("sensor_msgs/msg/PointCloud2", cloud_message, parse_scan),
    Frame: _Form("sensor_msgs/msg/CompressedImage", _build_frame, _parse_frame),
    SensorEvent: _Form("murk_msgs/msg/SensorEvent", _build_sensor_event, _parse_sensor_event),
    ModelChoice: _Form("murk_msgs/msg/ModelChoice", _build_choice, _parse_choice),
    NodeState: _Form("murk_msgs/msg/NodeState", _build_node_state, _parse_node_state),
    NodeEvent: _Form("murk_msgs/msg/NodeEvent", _build_node_event, _parse_node_event),
    InjectionRequest: _Form("murk_msgs/msg/Injection", _build_request, _parse_request),
}
_PARSERS = {form.type_name: form.parse for form in _FORMS.values()}
_INFO_TYPES = {
    "sensor_msgs/msg/PointCloud2": "murk_msgs/msg/RadarScanInfo",
    "sensor_msgs/msg/CompressedImage": "murk_msgs/msg/FrameInfo",
}
