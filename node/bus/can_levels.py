"""A noise level as a CAN frame, by ``dbc/noise_level.dbc``: what an ECU hears, and reading it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np
from crccheck.crc import Crc8SaeJ1850
from numpy.typing import NDArray

from dbc.codec import noise_level
from drivers.can_bus import open_bus
from drivers.can_frames import NO_FRAMES, CanFrames, FrameFlag
from node.health import State
from node.scene import SensorType

FIRST_ID = 0x6F0
MOST_SENSORS = 16
"""Identifiers that a reader listens to, from the first sensor's on."""
OLDEST_MS = 65535
COUNTS = 16
"""Values of the rolling counter."""

_CODES = {
    signal: {name: value for value, name in names.items()}
    for signal, names in noise_level().choices.items()
}


@dataclass(frozen=True, slots=True)
class CanLevel:
    """What one frame says of one sensor.

    Attributes
    ----------
    can_id:
        Identifier of the frame, which tells the sensor.
    stamp_ns:
        When the frame was received (0 in one that is to be sent), integer nanoseconds.
    sensor_type:
        ``"camera"`` or ``"radar"``.
    state:
        Whether the sensor speaks; the rest is the last known while it does not.
    level, std:
        Noise level and its standard deviation, %.
    kind, kind_probability:
        Most probable kind, ``"unknown"`` before the first level, and its probability, 0–1.
    age_ms:
        Since the frame or scan reached the node, ms; ``OLDEST_MS`` where longer ago or never.
    counter:
        Rolling counter, 0–15.
    """

    can_id: int
    stamp_ns: int
    sensor_type: SensorType
    state: State
    level: float
    std: float
    kind: str
    kind_probability: float
    age_ms: int
    counter: int


def encode_level(level: CanLevel) -> CanFrames:
    """Return the frame that says it; level, std and probability are rounded to 0.5 %."""
    payload = noise_level().encode(
        {
            "NoiseLevel_Level": level.level,
            "NoiseLevel_Std": level.std,
            "NoiseLevel_Kind": _CODES["NoiseLevel_Kind"].get(level.kind, 0),
            "NoiseLevel_State": _CODES["NoiseLevel_State"][level.state],
            "NoiseLevel_KindProbability": 100.0 * level.kind_probability,
            "NoiseLevel_Age": level.age_ms,
            "NoiseLevel_SensorType": _CODES["NoiseLevel_SensorType"][level.sensor_type],
            "NoiseLevel_Counter": level.counter,
            "NoiseLevel_Crc": 0,
        }
    )
    payload[0, -1] = checksum(level.can_id, payload[0])
    return CanFrames(
        stamp_ns=np.array([level.stamp_ns]),
        can_id=np.array([level.can_id], np.uint32),
        length=np.array([payload.shape[1]], np.uint8),
        data=payload,
        flags=np.zeros(1, np.uint8),
        channel=np.zeros(1, np.uint8),
    )


def checksum(can_id: int, payload: NDArray[np.uint8]) -> int:
    """Return the CRC-8 SAE J1850 of the identifier (two bytes, low first) and seven bytes."""
    return int(Crc8SaeJ1850.calc(can_id.to_bytes(2, "little") + payload[:7].tobytes()))


class LevelReader:
    """Levels that a node publishes on a CAN bus; iterate over it until ``close``.

    Parameters
    ----------
    bus:
        See ``drivers.can_bus.open_bus``.
    first_id:
        Identifier of the node's first sensor.

    Attributes
    ----------
    corrupt:
        Frames whose length or checksum was wrong; they are left out.
    lost:
        Frames missing by the counters of the others.

    Raises
    ------
    DeviceError
        If the bus cannot be opened.
    """

    def __init__(self, bus: str, first_id: int = FIRST_ID) -> None:
        self.corrupt = 0
        self.lost = 0
        self._counters: dict[int, int] = {}
        self._bus = open_bus(bus, ids=range(first_id, first_id + MOST_SENSORS), listen_only=True)

    def read(self, timeout_s: float) -> list[CanLevel]:
        """Return the levels that have come, waiting up to ``timeout_s`` for the first.

        Raises
        ------
        BusDown
            If the network is down or the interface has gone.
        """
        return list(self.decode(self._bus.read(timeout_s)))

    def decode(self, frames: CanFrames = NO_FRAMES) -> Iterator[CanLevel]:
        """Yield the levels of frames, counting what is corrupt and what is missing."""
        marks = frames.flags & ~np.uint8(FrameFlag.TRANSMITTED)  # a node of this computer sent it
        ordinary = (marks == 0) & (frames.length == noise_level().length)
        self.corrupt += int(np.count_nonzero(~ordinary))
        frames = frames.select(ordinary)
        for row, values in enumerate(_rows(frames)):
            can_id = int(frames.can_id[row])
            if checksum(can_id, frames.data[row]) != values["NoiseLevel_Crc"]:
                self.corrupt += 1
                continue
            counter = int(values["NoiseLevel_Counter"])
            before = self._counters.get(can_id, counter - 1)
            self.lost += (counter - before - 1) % COUNTS
            self._counters[can_id] = counter
            yield _level(can_id, int(frames.stamp_ns[row]), values)

    def __iter__(self) -> Iterator[CanLevel]:
        while True:
            yield from self.read(timeout_s=1.0)

    def close(self) -> None:
        """Close the bus."""
        self._bus.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _rows(frames: CanFrames) -> Iterator[dict[str, float]]:
    columns = noise_level().decode(frames.data)
    for row in range(len(frames)):
        yield {name: column[row] for name, column in columns.items()}


def _level(can_id: int, stamp_ns: int, values: dict[str, float]) -> CanLevel:
    def named(signal: str) -> str:
        return noise_level().choices[signal].get(int(values[signal]), "unknown")

    return CanLevel(
        can_id=can_id,
        stamp_ns=stamp_ns,
        sensor_type="radar" if named("NoiseLevel_SensorType") == "radar" else "camera",
        state=_STATES[int(values["NoiseLevel_State"])],
        level=float(values["NoiseLevel_Level"]),
        std=float(values["NoiseLevel_Std"]),
        kind=named("NoiseLevel_Kind"),
        kind_probability=float(values["NoiseLevel_KindProbability"]) / 100.0,
        age_ms=int(values["NoiseLevel_Age"]),
        counter=int(values["NoiseLevel_Counter"]),
    )


_STATES: dict[int, State] = {0: "never_seen", 1: "ok", 2: "stale", 3: "lost"}
