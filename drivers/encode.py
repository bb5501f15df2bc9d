"""Radar scans, radar states and ego motion as the CAN frames that carry them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from dbc.codec import MessageCodec, ars408
from dbc.errors import InputError
from drivers.ars408_layout import CAN_ID, ID_SHIFT, MODES, PAYLOAD_BYTES, Kind, ListLayout
from drivers.can_frames import CanFrames
from drivers.frame import StampSource
from drivers.scan import RadarScan, RadarState

BIT_NS = 2_000
"""One bit at 500 kbit/s, ns."""

FRAME_BITS = 47
"""Bits of a frame beside its payload: 11-bit ID, spacing included, nothing stuffed."""

INTERFACE_VERSION = 1
"""What every recorded status frame says."""

_STANDSTILL, _FORWARD, _REVERSE = 0, 1, 2


def encode_scan(scan: RadarScan, spacing_ns: int | None = None) -> CanFrames:
    """Return the frames of one scan: status, general list, then the lists whose fields it has.

    Values are rounded to the CAN grid; IDs and order stay. The status frame announces ``near`` and
    ``far`` as the scan has them, so a scan that lost frames is sent as one that loses them.

    Parameters
    ----------
    spacing_ns:
        From one frame to the next; None: back to back at 500 kbit/s. The status frame has the
        scan's stamp.

    Raises
    ------
    InputError
        If a value does not fit its signal, or a list lacks some of its fields.
    """
    mode = next(mode for mode in MODES.values() if mode.name == scan.mode)
    status = {
        mode.near: scan.near,
        mode.counter: scan.meas_counter,
        mode.version: INTERFACE_VERSION,
    }
    if mode.far:
        status[mode.far] = scan.far
    parts = [(mode.status_codec, mode.status_codec.encode(status))]
    for layout in mode.lists:
        if layout is mode.general or _has(scan, layout):
            columns = {signal: getattr(scan, field) for field, signal in layout.fields.items()}
            columns[layout.id_signal] = scan.id
            parts.append((layout.codec, layout.codec.encode(columns)))
    return _frames(parts, scan.sensor_id, scan.stamp_ns, scan.stamp_source, spacing_ns)


def encode_motion(
    speed: float,
    yaw_rate: float,
    stamp_ns: int = 0,
    sensor_id: int = 0,
    stamp_source: StampSource = "simulated",
) -> CanFrames:
    """Return the two frames (0x300, 0x301) that tell a radar how the vehicle moves.

    Parameters
    ----------
    speed:
        m/s, negative in reverse.
    yaw_rate:
        Degrees/s, counter-clockwise positive.

    Raises
    ------
    InputError
        If a value does not fit its signal: 163.82 m/s, -327.68 to 327.67 degrees/s.
    """
    speed_codec, yaw_rate_codec = _codec(Kind.SPEED), _codec(Kind.YAW_RATE)
    payload = speed_codec.encode(
        {
            "RadarDevice_Speed": abs(speed),
            "RadarDevice_SpeedDirection": _REVERSE if speed < 0 else _FORWARD,
        }
    )
    if speed_codec.decode(payload)["RadarDevice_Speed"][0] == 0:
        payload = speed_codec.encode(
            {"RadarDevice_Speed": 0, "RadarDevice_SpeedDirection": _STANDSTILL}
        )
    parts = [
        (speed_codec, payload),
        (yaw_rate_codec, yaw_rate_codec.encode({"RadarDevice_YawRate": yaw_rate})),
    ]
    return _frames(parts, sensor_id, stamp_ns, stamp_source)


def encode_state(state: RadarState, stamp_source: StampSource = "simulated") -> CanFrames:
    """Return the frame (0x201) of a radar state; signals that it does not name are 0.

    Raises
    ------
    InputError
        If a value does not fit its signal, or no signal has that name.
    """
    codec = _codec(Kind.RADAR_STATE)
    values: Mapping[str, float] = dict.fromkeys(codec.signals, 0.0) | state.values
    parts = [(codec, codec.encode(values))]
    return _frames(parts, state.sensor_id, state.stamp_ns, stamp_source)


def _codec(kind: Kind) -> MessageCodec:
    return ars408().message(CAN_ID[kind])


def _has(scan: RadarScan, layout: ListLayout) -> bool:
    """Whether a scan has the fields of an optional list."""
    absent = [field for field in layout.fields if getattr(scan, field) is None]
    if absent and len(absent) < len(layout.fields):
        raise InputError(f"scan {scan.sequence} of {scan.sensor}", f"has no {', '.join(absent)}")
    return not absent


def _frames(
    parts: list[tuple[MessageCodec, NDArray[np.uint8]]],
    sensor_id: int,
    stamp_ns: int,
    stamp_source: StampSource,
    spacing_ns: int | None = None,
) -> CanFrames:
    """Put payloads of several messages one after another."""
    counts = [len(payloads) for _, payloads in parts]
    lengths = np.repeat([codec.length for codec, _ in parts], counts)
    ids = np.repeat([codec.id + ID_SHIFT * sensor_id for codec, _ in parts], counts)
    data = np.zeros((len(ids), PAYLOAD_BYTES), np.uint8)
    row = 0
    for codec, payloads in parts:
        data[row : row + len(payloads), : codec.length] = payloads
        row += len(payloads)
    if spacing_ns is None:
        duration_ns = BIT_NS * (FRAME_BITS + 8 * lengths)
        offset_ns = np.cumsum(duration_ns) - duration_ns[0]
    else:
        offset_ns = spacing_ns * np.arange(len(ids))
    return CanFrames(
        stamp_ns=stamp_ns + offset_ns.astype(np.int64),
        can_id=ids.astype(np.uint32),
        length=lengths.astype(np.uint8),
        data=data,
        flags=np.zeros(len(ids), np.uint8),
        channel=np.zeros(len(ids), np.uint8),
        stamp_source=stamp_source,
    )
