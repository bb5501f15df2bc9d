"""A radar scan as a structure of arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drivers.frame import StampSource

FloatArray = NDArray[np.float32]
ByteArray = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RadarScan:
    """One measurement cycle of one ARS 408: clusters, or objects where ``mode`` says so.

    All arrays have length n. Optional arrays are None where the radar does not send them
    (quality switched off, or a field of the other mode).

    Attributes
    ----------
    sensor:
        The radar's name in the scene.
    sensor_id:
        SensorID 0–7, the offset of its CAN IDs.
    sequence:
        Count of cycles of this source, from 0, lost cycles counted in: a gap is a lost cycle.
    stamp_ns:
        When the cycle's status frame was received, integer nanoseconds.
    stamp_source:
        How the stamp was taken.
    mode:
        ``"cluster"`` (0x600/701/702) or ``"object"`` (0x60A–60E).
    meas_counter:
        MeasCounter of the status frame, 0–65535.
    near, far:
        Clusters announced by the status frame in near and far scan; object mode: (objects, 0).
    frames_lost:
        List frames of this scan that were announced and never came.
    cycles_lost:
        Whole cycles lost immediately before this one, by the counter and its learned step.
    duplicates, strays:
        Frames of this scan that came twice, or that belong to no announced scan.
    dropped:
        Frames dropped by the kernel since the bus was opened, where it tells.
    injected:
        ``{kind: level in %}`` that was injected before the source gave it, where it says so.
    drawn:
        Of these the drawn parameters by kind, where the source knows them.
    id:
        (n,) uint8, cluster or object ID.
    x, y:
        (n,) float32, m, sensor frame: x ahead, y to the left.
    vx, vy:
        (n,) float32, m/s, relative to the sensor.
    rcs:
        (n,) float32, dBm².
    dyn_prop:
        (n,) uint8, DynProp value table.
    x_rms, y_rms, vx_rms, vy_rms:
        (n,) uint8, RMS index 0–31 (``drivers.ars408.RMS_METRES`` gives m or m/s).
    pdh0, ambig_state, invalid_state:
        (n,) uint8, cluster quality value tables.
    prob_of_exist, meas_state:
        (n,) uint8, object quality value tables.
    ax_rms, ay_rms, orientation_rms:
        (n,) uint8, object RMS indices 0–31.
    ax, ay:
        (n,) float32, m/s², relative.
    object_class:
        (n,) uint8, object class value table.
    orientation:
        (n,) float32, degrees.
    length, width:
        (n,) float32, m.
    """

    sensor: str
    sensor_id: int
    sequence: int
    stamp_ns: int
    stamp_source: StampSource
    mode: Literal["cluster", "object"]
    meas_counter: int
    near: int
    far: int
    frames_lost: int = 0
    cycles_lost: int = 0
    duplicates: int = 0
    strays: int = 0
    dropped: int = 0
    injected: Mapping[str, float] | None = None
    drawn: Mapping[str, Any] | None = None
    id: ByteArray
    x: FloatArray
    y: FloatArray
    vx: FloatArray
    vy: FloatArray
    rcs: FloatArray
    dyn_prop: ByteArray
    x_rms: ByteArray | None = None
    y_rms: ByteArray | None = None
    vx_rms: ByteArray | None = None
    vy_rms: ByteArray | None = None
    pdh0: ByteArray | None = None
    ambig_state: ByteArray | None = None
    invalid_state: ByteArray | None = None
    prob_of_exist: ByteArray | None = None
    meas_state: ByteArray | None = None
    ax_rms: ByteArray | None = None
    ay_rms: ByteArray | None = None
    orientation_rms: ByteArray | None = None
    ax: FloatArray | None = None
    ay: FloatArray | None = None
    object_class: ByteArray | None = None
    orientation: FloatArray | None = None
    length: FloatArray | None = None
    width: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.x)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that this scan has, by field name, in order of declaration."""
        values = ((field.name, getattr(self, field.name)) for field in fields(self))
        return {name: value for name, value in values if isinstance(value, np.ndarray)}


@dataclass(frozen=True, slots=True)
class RadarState:
    """What the radar says of itself (0x201, 1 Hz). Attribute names follow the DBC's signals.

    Attributes
    ----------
    stamp_ns:
        When the frame was received, integer nanoseconds.
    values:
        Physical value by signal name, e.g. ``RadarState_MaxDistanceCfg`` in m.
    """

    sensor: str
    sensor_id: int
    stamp_ns: int
    values: dict[str, float]


@dataclass(frozen=True, slots=True)
class MotionInput:
    """The ego motion that somebody sends to the radar (0x300 and 0x301).

    Attributes
    ----------
    stamp_ns:
        When the newer of the two frames was received, integer nanoseconds.
    speed:
        m/s, negative in reverse; None until a 0x300 has come.
    yaw_rate:
        degrees/s, counter-clockwise positive; None until a 0x301 has come.
    """

    sensor_id: int
    stamp_ns: int
    speed: float | None
    yaw_rate: float | None
