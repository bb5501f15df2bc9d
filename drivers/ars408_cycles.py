"""Cluster cycles inside a recorded stream: where they are, and how another scan takes their place.

Everything that belongs to no cluster cycle stays as it is and where it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.ars408 import ScanAssembler
from drivers.ars408_layout import (
    CAN_ID,
    ID_SHIFT,
    PAYLOAD_BYTES,
    SENSOR_IDS,
    Kind,
    shortest_payload,
)
from drivers.can_frames import CanFrames, FrameFlag, concatenate
from drivers.encode import encode_scan
from drivers.scan import RadarScan

IndexArray = NDArray[np.intp]

_LISTS = (Kind.CLUSTER_STATUS, Kind.CLUSTER_GENERAL, Kind.CLUSTER_QUALITY)
_FOREIGN = int(FrameFlag.EXTENDED | FrameFlag.REMOTE | FrameFlag.ERROR | FrameFlag.FD)
_COUNTS_BYTES = 2
"""The status frame begins with how many clusters there are in the near and in the far list."""
_TYPICAL_SPACING_NS = 250_000


@dataclass(frozen=True, slots=True, eq=False)
class Cycle:
    """One cluster cycle of one radar.

    Attributes
    ----------
    rows:
        (k,) the frames of its lists in the stream, its status frame first.
    end_ns:
        Stamp of the same radar's next status frame; None where none follows.
    sensor:
        ``<interface>.radar_<SensorID>``.
    scan:
        What they say; ``sequence`` counts the cycles of this radar in the stream.
    """

    rows: IndexArray
    end_ns: int | None
    sensor: str
    scan: RadarScan


def find_cycles(frames: CanFrames) -> Iterator[Cycle]:
    """Yield the cluster cycles of every radar of a stream, radar by radar.

    A cycle is a status frame and the lists until the same radar's next one. One of which no cluster
    came is left out. Frames before the first status frame belong to none.
    """
    kinds, sensor_ids = _kinds(frames)
    for channel in np.unique(frames.channel).tolist():
        for sensor_id in SENSOR_IDS:
            own = np.flatnonzero(
                (kinds > 0) & (sensor_ids == sensor_id) & (frames.channel == channel)
            )
            name = f"{frames.channels[channel]}.radar_{sensor_id}"
            yield from _cycles(frames, own, kinds[own], {sensor_id: name})


def replace_cycles(frames: CanFrames, changed: Iterable[tuple[Cycle, RadarScan]]) -> CanFrames:
    """Return the stream with other scans in the place of some cycles.

    A scan's frames take the places and the stamps of those that they replace, in order. What a
    shorter scan does not need goes; what a longer one needs beside follows the last one, as far
    apart as the cycle's frames are, before the radar's next status frame. Of the status frame only
    the counts change.
    """
    order = np.maximum.accumulate(frames.stamp_ns) if len(frames) else frames.stamp_ns
    gone = np.zeros(len(frames), bool)
    parts, keys = [], []
    for cycle, scan in changed:
        rows = cycle.rows
        gone[rows] = True
        new = encode_scan(scan)
        new.data[0, _COUNTS_BYTES:] = frames.data[rows[0], _COUNTS_BYTES:PAYLOAD_BYTES]
        new.length[0] = frames.length[rows[0]]
        new.channel[:] = frames.channel[rows[0]]
        new.flags[:] = frames.flags[rows[0]]
        kept = rows[: len(new)]
        later = _later_ns(frames.stamp_ns[rows], len(new) - len(kept), cycle.end_ns)
        new.stamp_ns[:] = np.concatenate([frames.stamp_ns[kept], later])
        parts.append(replace(new, channels=frames.channels, stamp_source=frames.stamp_source))
        stamp_keys = np.append(order[kept], np.maximum(later, order[rows[-1]]))
        row_keys = np.append(kept, np.full(len(later), rows[-1]))
        keys.append(np.stack([stamp_keys, row_keys]))
    if not parts:
        return frames
    stay = np.flatnonzero(~gone)
    joined = concatenate([frames.select(stay), *parts])
    stamp, row = np.concatenate([np.stack([order[stay], stay]), *keys], axis=1)
    return joined.select(np.lexsort((row, stamp)))


def _kinds(frames: CanFrames) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the kind of each frame of a cluster cycle, 0 for all others, and its SensorID."""
    kind_of_id, sensor_of_id = np.zeros(0x801, np.uint8), np.zeros(0x801, np.uint8)
    for sensor_id in SENSOR_IDS:
        for kind in _LISTS:
            kind_of_id[CAN_ID[kind] + ID_SHIFT * sensor_id] = kind
            sensor_of_id[CAN_ID[kind] + ID_SHIFT * sensor_id] = sensor_id
    can_id = np.minimum(frames.can_id, 0x800).astype(np.intp)
    kinds = kind_of_id[can_id]
    kinds[(frames.flags & _FOREIGN != 0) | (frames.length < shortest_payload()[kinds])] = 0
    return kinds, sensor_of_id[can_id]


def _cycles(
    frames: CanFrames, rows: IndexArray, kinds: NDArray[np.uint8], sensors: dict[int, str]
) -> Iterator[Cycle]:
    starts = np.flatnonzero(kinds == Kind.CLUSTER_STATUS).tolist()
    sequence = 0
    for start, end in pairwise([*starts, len(rows)]):
        own = rows[start:end]
        assembler = ScanAssembler(sensors)  # a new one: lists of another cycle tell nothing here
        items = assembler.feed(frames.select(own)) + assembler.flush()
        scans = [item for item in items if isinstance(item, RadarScan) and len(item)]
        end_ns = int(frames.stamp_ns[rows[end]]) if end < len(rows) else None
        for scan in scans:  # one, or none
            yield Cycle(own, end_ns, scan.sensor, replace(scan, sequence=sequence))
            sequence += 1


def _later_ns(stamp_ns: NDArray[np.int64], count: int, end_ns: int | None) -> NDArray[np.int64]:
    """Return the stamps of frames that a cycle had none for, whole microseconds apart."""
    gaps = np.diff(stamp_ns)
    spacing = int(np.median(gaps)) if len(gaps) else _TYPICAL_SPACING_NS
    last = int(stamp_ns[-1])
    if end_ns is not None:
        spacing = min(spacing, max(end_ns - last, 0) // (count + 1))
    return last + max(spacing, 0) // 1000 * 1000 * np.arange(1, count + 1, dtype=np.int64)
