"""A radar scan as a ``sensor_msgs/PointCloud2`` and a ``murk_msgs/RadarScanInfo``, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.typesys.store import Typestore

from drivers.frame import Frame
from drivers.scan import RadarScan
from models.degrade.parameters import from_json, to_json
from models.estimate.level import NoiseLevel

_DATATYPES = {np.dtype(np.uint8): 2, np.dtype(np.float32): 7}
"""``sensor_msgs/PointField`` constants UINT8 and FLOAT32."""
_DTYPES = {datatype: dtype for dtype, datatype in _DATATYPES.items()}
_POSITION = ("x", "y", "z")
_COUNTS = ("meas_counter", "near", "far", "frames_lost", "cycles_lost", "duplicates", "strays")
_HEAD = ("sequence", "stamp_source", "sensor_id", "mode", *_COUNTS, "dropped")
"""Attributes of a scan that ``RadarScanInfo`` has under the same name."""


def ros_time(stamp_ns: int, store: Typestore) -> Any:
    """Return a ``builtin_interfaces/Time``."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return store.types["builtin_interfaces/msg/Time"](seconds, nanoseconds)


def time_ns_of(stamp: Any) -> int:
    """Return the nanoseconds of a ``builtin_interfaces/Time``."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def injected_fields(message: Frame | RadarScan | NoiseLevel) -> dict[str, Any]:
    """Return the fields of a ROS message that say what was injected, and how it was drawn."""
    injected, drawn = message.injected or {}, message.drawn or {}
    return {
        "injected_kinds": list(injected),
        "injected_levels": np.array(list(injected.values()), np.float64),
        "injected_drawn": [to_json(drawn[kind]) if kind in drawn else "" for kind in injected],
    }


def injected_of(message: Any) -> dict[str, float] | None:
    """Return the levels that those fields say; None where nothing was injected.

    Raises
    ------
    ValueError
        If they are not of one length.
    """
    kinds, levels = message.injected_kinds, message.injected_levels.tolist()
    return dict(zip(kinds, levels, strict=True)) or None


def drawn_of(message: Any) -> dict[str, Any] | None:
    """Return the drawn parameters that those fields say; None where they say none.

    Raises
    ------
    ValueError
        If they are not of one length, or hold something else.
    """
    texts = zip(message.injected_kinds, message.injected_drawn, strict=True)
    return {kind: from_json(text) for kind, text in texts if text} or None


def cloud_message(scan: RadarScan, store: Typestore) -> Any:
    """Return a scan's points as an unorganised cloud, a field an array that the scan has.

    ``x``, ``y``, ``z`` (m, ``z`` always 0) come first, then the other arrays under their names in
    ``RadarScan``: ``vx``, ``vy`` (m/s), ``rcs`` (dBm²) and so on as FLOAT32, flags as UINT8.
    """
    arrays = scan.arrays()
    arrays["z"] = np.zeros(len(scan), np.float32)
    names = [*_POSITION, *(name for name in arrays if name not in _POSITION)]
    layout = np.dtype([(name, arrays[name].dtype) for name in names])
    points = np.empty(len(scan), layout)
    for name in names:
        points[name] = arrays[name]
    types = store.types
    field = types["sensor_msgs/msg/PointField"]
    offsets = [layout.fields[name][1] for name in names] if layout.fields else []
    return types["sensor_msgs/msg/PointCloud2"](
        header=types["std_msgs/msg/Header"](ros_time(scan.stamp_ns, store), scan.sensor),
        height=1,
        width=len(scan),
        fields=[
            field(name, offset, _DATATYPES[arrays[name].dtype], 1)
            for name, offset in zip(names, offsets, strict=True)
        ],
        is_bigendian=False,
        point_step=layout.itemsize,
        row_step=layout.itemsize * len(scan),
        data=points.view(np.uint8),
        is_dense=True,
    )


def scan_info_message(scan: RadarScan, store: Typestore) -> Any:
    """Return what a scan carries beside its points."""
    types = store.types
    header = types["std_msgs/msg/Header"](ros_time(scan.stamp_ns, store), scan.sensor)
    values = {name: getattr(scan, name) for name in _HEAD}
    return types["murk_msgs/msg/RadarScanInfo"](header, **values, **injected_fields(scan))


def parse_scan(cloud: Any, info: Any) -> RadarScan:
    """Return the scan of a cloud and what came beside it, equal to the first to the last bit.

    Raises
    ------
    ValueError, KeyError, TypeError
        If the cloud is none that ``cloud_message`` makes.
    """
    layout = np.dtype(
        {
            "names": [field.name for field in cloud.fields],
            "formats": [_DTYPES[field.datatype] for field in cloud.fields],
            "offsets": [field.offset for field in cloud.fields],
            "itemsize": cloud.point_step,
        }
    )
    points = np.frombuffer(cloud.data, layout)
    if len(points) != cloud.width * cloud.height:
        raise ValueError(f"{len(points)} points, but width and height say otherwise")
    arrays: dict[str, Any] = {
        field.name: points[field.name].copy() for field in cloud.fields if field.name != "z"
    }
    return RadarScan(
        sensor=info.header.frame_id,
        stamp_ns=time_ns_of(info.header.stamp),
        injected=injected_of(info),
        drawn=drawn_of(info),
        **{name: getattr(info, name) for name in _HEAD},
        **arrays,
    )
