"""``murk decode``: the clusters and objects of a CAN log."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from node.cli.output import emit

if TYPE_CHECKING:
    from drivers.scan import RadarScan

DECIMALS = 4
CHUNK_BYTES = 1 << 20


def decode(
    log: Annotated[Path, typer.Argument(help="A CAN log: candump, asc, blf, trc, …, or MCAP.")],
    json: Annotated[bool, typer.Option("--json", help="One JSON object a scan.")] = False,
) -> None:
    """Decode a CAN log: a CSV row a cluster or object, or with --json an object a scan."""
    from dbc.errors import LogError
    from node.recording import is_recording

    lost = {"scans": 0, "frames_lost": 0, "cycles_lost": 0, "duplicates": 0, "strays": 0}
    show = _emit_scan if json else _Rows().write
    for scan in _scans(log):
        show(scan)
        lost["scans"] += 1
        for name in list(lost)[1:]:
            lost[name] += getattr(scan, name)
    if not lost["scans"] and is_recording(str(log)):
        raise LogError(log, "holds no radar scan", "record with scans in [outputs.record]")
    if not lost["scans"]:
        raise LogError(log, "holds no radar scan", "expected CAN IDs 0x600 or 0x60A (+ 0x10 × ID)")
    sys.stdout.flush()
    words = ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in lost.items())
    sys.stderr.write(f"{log}: {words}\n")


def _scans(log: Path) -> Iterator[RadarScan]:
    """Yield the scans of every radar on every bus of a log, or of every radar of a recording.

    A radar on the bus that the log names first is ``radar_<SensorID>``, one on another bus
    ``<bus>.radar_<SensorID>``.
    """
    from drivers.ars408 import ScanAssembler
    from drivers.ars408_layout import SENSOR_IDS
    from drivers.can_log import read_log
    from drivers.scan import RadarScan
    from node.recording import is_recording, open_sensors

    if is_recording(str(log)):
        for sensor, source in open_sensors(log):
            if sensor.type == "radar":
                yield from (scan for scan in source.messages() if isinstance(scan, RadarScan))
        return
    assemblers: list[ScanAssembler] = []
    for frames in read_log(log, CHUNK_BYTES):
        for bus in frames.channels[len(assemblers) :]:
            prefix = f"{bus}." if assemblers else ""
            assemblers.append(ScanAssembler({n: f"{prefix}radar_{n}" for n in SENSOR_IDS}))
        for index, assembler in enumerate(assemblers):
            own = frames if len(assemblers) == 1 else frames.select(frames.channel == index)
            yield from (item for item in assembler.feed(own) if isinstance(item, RadarScan))
    for assembler in assemblers:
        yield from (item for item in assembler.flush() if isinstance(item, RadarScan))


def _emit_scan(scan: RadarScan) -> None:
    values = {field.name: getattr(scan, field.name) for field in fields(scan)}
    emit({name: _finite(value) for name, value in values.items() if value is not None})


def _finite(value: Any) -> Any:
    """Return an array as a list in which None stands for what was lost (NaN)."""
    import numpy as np

    if not isinstance(value, np.ndarray) or value.dtype.kind != "f":
        return value
    # The sensor's grids have two decimals at most; float32 read as float64 would show eight more.
    rounded = np.round(value.astype(np.float64), DECIMALS).tolist()
    return [None if one != one else one for one in rounded]


class _Rows:
    """Writes CSV rows; the columns are all that the first scan's mode can have."""

    def __init__(self) -> None:
        self._writer = csv.writer(sys.stdout, lineterminator="\n")
        self._columns: list[str] = []

    def write(self, scan: RadarScan) -> None:
        """Write a scan's clusters or objects, before the first one the header."""
        if not self._columns:
            self._columns = _columns(scan.mode)
            self._writer.writerow(["stamp_ns", "sensor", "sequence", *self._columns])
        values = [getattr(scan, name) for name in self._columns]
        empty = [""] * len(scan)
        columns = [empty if value is None else _finite(value) for value in values]
        head = (scan.stamp_ns, scan.sensor, scan.sequence)
        self._writer.writerows((*head, *row) for row in zip(*columns, strict=True))


def _columns(mode: str) -> list[str]:
    """Return the array fields that a mode can have, in order of declaration."""
    from drivers.ars408_layout import CLUSTER_MODE, OBJECT_MODE
    from drivers.scan import RadarScan

    layouts = (CLUSTER_MODE if mode == "cluster" else OBJECT_MODE).lists
    names = {name for layout in layouts for name in layout.fields}
    return [field.name for field in fields(RadarScan) if field.name in names]
