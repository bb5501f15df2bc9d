"""Which CAN frames an ARS 408-21 sends, and which field of a scan each signal becomes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dbc.codec import MessageCodec, ars408

SENSOR_IDS = range(8)
ID_SHIFT = 0x10
"""Sensor n shifts each CAN ID by ``ID_SHIFT * n``."""

PAYLOAD_BYTES = 8

RMS_METRES = np.append(np.round(0.005 * 2000.0 ** (np.arange(31) / 30.0), 3), np.nan)
"""Standard deviation by RMS index, m or m/s, shape (32,); index 31 is invalid, so NaN."""


_CACHEFUL = 1024
"""Frames whose decoded signals stay in a processor's cache."""

NO_RMS = 31
NO_VALUE = {"pdh0": 0, "ambig_state": 0, "prob_of_exist": 0, "meas_state": 7, "object_class": 7}
"""What a uint8 field holds where its frame was lost: its code for invalid, or one without meaning.
``NO_RMS`` where not named here; a float field holds NaN."""


class Kind(IntEnum):
    """What a CAN frame is to the assembler."""

    OTHER = 0
    CLUSTER_STATUS = 1
    CLUSTER_GENERAL = 2
    CLUSTER_QUALITY = 3
    OBJECT_STATUS = 4
    OBJECT_GENERAL = 5
    OBJECT_QUALITY = 6
    OBJECT_EXTENDED = 7
    RADAR_STATE = 8
    SPEED = 9
    YAW_RATE = 10
    TOO_SHORT = 11


CAN_ID = {
    Kind.CLUSTER_STATUS: 0x600,
    Kind.CLUSTER_GENERAL: 0x701,
    Kind.CLUSTER_QUALITY: 0x702,
    Kind.OBJECT_STATUS: 0x60A,
    Kind.OBJECT_GENERAL: 0x60B,
    Kind.OBJECT_QUALITY: 0x60C,
    Kind.OBJECT_EXTENDED: 0x60D,
    Kind.RADAR_STATE: 0x201,
    Kind.SPEED: 0x300,
    Kind.YAW_RATE: 0x301,
}
"""CAN ID of sensor 0 by kind."""


@dataclass(frozen=True)
class ListLayout:
    """One list of a cycle: a frame for each cluster or object.

    Attributes
    ----------
    id_signal:
        The signal that joins the lists of a cycle.
    floats, bytes:
        Signal name by name of the ``RadarScan`` field: float32 and uint8 ones.
    """

    kind: Kind
    id_signal: str
    floats: dict[str, str]
    bytes: dict[str, str]

    @cached_property
    def codec(self) -> MessageCodec:
        """The list's message."""
        return ars408().message(CAN_ID[self.kind])

    @property
    def fields(self) -> dict[str, str]:
        """Signal name by field name, of both types."""
        return self.floats | self.bytes

    def no_value(self, field: str) -> float:
        """Return what a field holds where the frame that carries it was lost."""
        return np.nan if field in self.floats else NO_VALUE.get(field, NO_RMS)

    def decode(self, payloads: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
        """Return payloads (N, 8) as the fields of a scan, (N,) each; a cacheful at a time."""
        fields: dict[str, NDArray[Any]] = {}
        for names, dtype in ((self.bytes, np.uint8), (self.floats, np.float32)):
            fields |= {field: np.empty(len(payloads), dtype) for field in names}
        for begin in range(0, len(payloads), _CACHEFUL):
            part = slice(begin, begin + _CACHEFUL)
            columns = self.codec.decode(payloads[part])
            for field, signal in self.fields.items():
                fields[field][part] = columns[signal]
        return fields


@dataclass(frozen=True)
class ModeLayout:
    """The frames of one cycle: a status frame, the general list, and the lists that may follow.

    Attributes
    ----------
    near, far, counter, version:
        Signals of the status frame; ``far`` is None where it announces one number only.
    """

    name: Literal["cluster", "object"]
    status: Kind
    near: str
    far: str | None
    counter: str
    version: str
    general: ListLayout
    optional: tuple[ListLayout, ...]

    @cached_property
    def status_codec(self) -> MessageCodec:
        """The status frame's message."""
        return ars408().message(CAN_ID[self.status])

    @property
    def lists(self) -> tuple[ListLayout, ...]:
        """The general list, then the optional ones."""
        return self.general, *self.optional


def _general(kind: Kind, prefix: str) -> ListLayout:
    floats = {"x": "DistLong", "y": "DistLat", "vx": "VrelLong", "vy": "VrelLat", "rcs": "RCS"}
    return ListLayout(
        kind,
        prefix + "ID",
        {field: prefix + signal for field, signal in floats.items()},
        {"id": prefix + "ID", "dyn_prop": prefix + "DynProp"},
    )


CLUSTER_MODE = ModeLayout(
    name="cluster",
    status=Kind.CLUSTER_STATUS,
    near="Cluster_NofClustersNear",
    far="Cluster_NofClustersFar",
    counter="Cluster_MeasCounter",
    version="Cluster_InterfaceVersion",
    general=_general(Kind.CLUSTER_GENERAL, "Cluster_"),
    optional=(
        ListLayout(
            Kind.CLUSTER_QUALITY,
            "Cluster_ID",
            {},
            {
                "x_rms": "Cluster_DistLong_rms",
                "y_rms": "Cluster_DistLat_rms",
                "vx_rms": "Cluster_VrelLong_rms",
                "vy_rms": "Cluster_VrelLat_rms",
                "pdh0": "Cluster_Pdh0",
                "ambig_state": "Cluster_AmbigState",
                "invalid_state": "Cluster_InvalidState",
            },
        ),
    ),
)

OBJECT_MODE = ModeLayout(
    name="object",
    status=Kind.OBJECT_STATUS,
    near="Obj_NofObjects",
    far=None,
    counter="Obj_MeasCounter",
    version="Obj_InterfaceVersion",
    general=_general(Kind.OBJECT_GENERAL, "Obj_"),
    optional=(
        ListLayout(
            Kind.OBJECT_QUALITY,
            "Obj_ID",
            {},
            {
                "x_rms": "Obj_DistLong_rms",
                "y_rms": "Obj_DistLat_rms",
                "vx_rms": "Obj_VrelLong_rms",
                "vy_rms": "Obj_VrelLat_rms",
                "prob_of_exist": "Obj_ProbOfExist",
                "meas_state": "Obj_MeasState",
                "ax_rms": "Obj_ArelLong_rms",
                "ay_rms": "Obj_ArelLat_rms",
                "orientation_rms": "Obj_Orientation_rms",
            },
        ),
        ListLayout(
            Kind.OBJECT_EXTENDED,
            "Obj_ID",
            {
                "ax": "Obj_ArelLong",
                "ay": "Obj_ArelLat",
                "orientation": "Obj_OrientationAngle",
                "length": "Obj_Length",
                "width": "Obj_Width",
            },
            {"object_class": "Obj_Class"},
        ),
    ),
)

MODES = {mode.status: mode for mode in (CLUSTER_MODE, OBJECT_MODE)}
"""Mode by the kind of its status frame."""


def sensor_can_ids(sensor_id: int) -> list[int]:
    """Return the CAN IDs that the assembler reads of one sensor, ascending."""
    return sorted(can_id + ID_SHIFT * sensor_id for can_id in CAN_ID.values())


def kind_table(sensor_ids: list[int]) -> NDArray[np.uint8]:
    """Return ``16 * sensor + kind`` by CAN ID, shape (2048,); 0 where it is none of theirs."""
    table = np.zeros(0x800, np.uint8)
    for sensor_id in sensor_ids:
        for kind, can_id in CAN_ID.items():
            table[can_id + ID_SHIFT * sensor_id] = 16 * sensor_id + kind
    return table


def shortest_payload() -> NDArray[np.uint8]:
    """Return the payload bytes that a frame must have, by kind."""
    shortest = np.zeros(16, np.uint8)
    for kind, can_id in CAN_ID.items():
        shortest[kind] = ars408().message(can_id).length
    return shortest
