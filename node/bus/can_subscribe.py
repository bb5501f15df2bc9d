"""Noise levels from a CAN bus, as ``NoiseLevel``."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from time import sleep

import numpy as np

from drivers.can_bus import BusDown
from models.estimate.level import LEVELS, NoiseLevel
from node.bus.can_levels import FIRST_ID, CanLevel, LevelReader

TICK_S = 0.05
SAME_NS = 10_000_000
"""Frames that date their level alike within this repeat it: 100 levels a second is the fastest."""


def can_levels(bus: str, sensors: Sequence[str]) -> Iterator[NoiseLevel | None]:
    """Yield each new level on a CAN bus, and None where none came for a while.

    A node repeats a sensor's last level while it is silent; repetitions are left out, and so is
    what it says of a sensor that is not ok. What CAN does not carry is NaN, None or 0.

    Parameters
    ----------
    bus:
        See ``drivers.can_bus.open_bus``.
    sensors:
        Names of the node's sensors, in the order of its scene.

    Raises
    ------
    DeviceError
        If the bus cannot be opened, told at once.
    """
    return _new_levels(LevelReader(bus), sensors)


def _new_levels(reader: LevelReader, sensors: Sequence[str]) -> Iterator[NoiseLevel | None]:
    newest_ns: dict[int, int] = {}
    with reader:
        while True:
            found = False
            for heard in _read(reader):
                number = heard.can_id - FIRST_ID
                arrival_ns = heard.stamp_ns - heard.age_ms * 1_000_000
                if heard.state != "ok" or number >= len(sensors):
                    continue
                if arrival_ns - newest_ns.get(number, arrival_ns - SAME_NS) >= SAME_NS:
                    newest_ns[number] = arrival_ns
                    found = True
                    yield _noise_level(heard, sensors[number], arrival_ns)
            if not found:
                yield None


def _read(reader: LevelReader) -> list[CanLevel]:
    try:
        return reader.read(TICK_S)
    except BusDown:
        sleep(TICK_S)  # silent, and it may come back
        return []


def _noise_level(heard: CanLevel, sensor: str, arrival_ns: int) -> NoiseLevel:
    return NoiseLevel(
        sensor=sensor,
        stamp_ns=arrival_ns,
        level=heard.level,
        std=heard.std,
        probabilities=np.full(len(LEVELS), np.nan),
        kind=heard.kind,
        kind_probabilities={heard.kind: heard.kind_probability},
        raw=math.nan,
        injected=None,
        latency_ns=0,
        sequence=heard.counter,
        dropped=0,
    )
