"""The CAN traffic of a simulated radar: its scans, its state and version, the ego's motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dbc.codec import ars408
from drivers.ars408_layout import ID_SHIFT, PAYLOAD_BYTES
from drivers.can_frames import CanFrames, concatenate
from drivers.encode import encode_motion, encode_scan, encode_state
from drivers.scan import RadarScan, RadarState
from models.world.road import EPOCH_NS, World

MOTION_NS = 50_000_000
"""From one motion input (0x300, 0x301) to the next, ns."""

STATE_NS = 1_000_000_000
"""From one radar state (0x201) and version (0x700) to the next, ns."""

_VERSION_ID = 0x700


def cycle_frames(world: World, scan: RadarScan, start_ns: int, end_ns: int) -> CanFrames:
    """Return a scan's frames and all periodic ones from ``start_ns`` to before ``end_ns``.

    Times are stamps, integer nanoseconds; the frames come in order of time.
    """
    parts = [encode_scan(scan)]
    for stamp_ns in _ticks(start_ns, end_ns, STATE_NS):
        parts += [encode_state(_state(scan, stamp_ns)), _version(scan, stamp_ns)]
    for stamp_ns in _ticks(start_ns, end_ns, MOTION_NS):
        ego = world.ego((stamp_ns - EPOCH_NS) / 1e9)
        yaw_rate = float(np.degrees(ego.yaw_rate))
        parts.append(encode_motion(ego.speed, yaw_rate, stamp_ns, scan.sensor_id))
    frames = concatenate(parts)
    return frames.select(np.argsort(frames.stamp_ns, kind="stable"))


def _ticks(start_ns: int, end_ns: int, period_ns: int) -> range:
    """Return the whole multiples of a period since the epoch within an interval."""
    first = -((EPOCH_NS - start_ns) // period_ns)
    return range(EPOCH_NS + first * period_ns, end_ns, period_ns)


def _state(scan: RadarScan, stamp_ns: int) -> RadarState:
    """Return the state of a radar that sends clusters, and quality where the scan has it."""
    values = {
        "RadarState_MaxDistanceCfg": 250.0,
        "RadarState_SensorID": float(scan.sensor_id),
        "RadarState_SendQualityCfg": float(scan.pdh0 is not None),
        "RadarState_OutputTypeCfg": 2.0,
        "RadarState_SortIndex": 1.0,
    }
    return RadarState(scan.sensor, scan.sensor_id, stamp_ns, values)


def _version(scan: RadarScan, stamp_ns: int) -> CanFrames:
    """Return the version frame: release 4.30.1, extended range."""
    codec = ars408().message(_VERSION_ID)
    release = {
        "Version_MajorRelease": 4,
        "Version_MinorRelease": 30,
        "Version_PatchLevel": 1,
        "Version_ExtendedRange": 1,
        "Version_CountryCode": 0,
    }
    data = np.zeros((1, PAYLOAD_BYTES), np.uint8)
    data[:, : codec.length] = codec.encode(release)
    return replace(
        encode_state(_state(scan, stamp_ns)),
        can_id=np.array([_VERSION_ID + ID_SHIFT * scan.sensor_id], np.uint32),
        length=np.array([codec.length], np.uint8),
        data=data,
    )
