"""Frames of radar cycles, and what the tests of the assembler compare."""

from __future__ import annotations

from typing import Any

import numpy as np
from radar_strategies import (
    random_scan,
)

from drivers.can_frames import CanFrames
from drivers.encode import encode_scan, encode_state
from drivers.scan import RadarScan, RadarState

CYCLE_NS = 72_000_000


def state_frame(quality: bool, extended: bool = False, sensor_id: int = 0) -> CanFrames:
    values = {
        "RadarState_SendQualityCfg": float(quality),
        "RadarState_SendExtInfoCfg": float(extended),
    }
    return encode_state(RadarState("", sensor_id, 0, values))


def cycle(
    number: int, n: int = 3, *lists: bool, mode: str = "cluster", **more: Any
) -> tuple[RadarScan, CanFrames]:
    """Return the scan of a cycle whose counter rises by 2, and its frames."""
    more = {"meas_counter": 2 * number % 65536, "stamp_ns": number * CYCLE_NS} | more
    scan = random_scan(np.random.default_rng(number), n, mode, lists or [True, True], **more)
    return scan, encode_scan(scan)


def without(frames: CanFrames, *rows: int) -> CanFrames:
    return frames.select(np.delete(np.arange(len(frames)), rows))


def radar_scans(items: list[Any]) -> list[RadarScan]:
    return [item for item in items if isinstance(item, RadarScan)]


def same_arrays(scan: RadarScan, other: RadarScan) -> bool:
    mine, theirs = scan.arrays(), other.arrays()
    return mine.keys() == theirs.keys() and all(
        np.array_equal(mine[name], theirs[name], equal_nan=mine[name].dtype.kind == "f")
        for name in mine
    )


# How a stream is cut makes no difference
