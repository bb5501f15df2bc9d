"""Radar scans of nuScenes: the data set's own binary PCD files, one ARS 408 cycle each."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from drivers.scan import RadarScan

POINT = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("dyn_prop", "i1"),
        ("id", "<i2"),
        ("rcs", "<f4"),
        ("vx", "<f4"),
        ("vy", "<f4"),
        ("vx_comp", "<f4"),
        ("vy_comp", "<f4"),
        ("is_quality_valid", "i1"),
        ("ambig_state", "i1"),
        ("x_rms", "i1"),
        ("y_rms", "i1"),
        ("invalid_state", "i1"),
        ("pdh0", "i1"),
        ("vx_rms", "i1"),
        ("vy_rms", "i1"),
    ]
)
"""One point: 43 bytes. ``vx_comp``, ``vy_comp``: radial velocity over ground, as a vector, m/s."""

FLOATS = ("x", "y", "vx", "vy", "rcs")
CODES = (
    "dyn_prop",
    "ambig_state",
    "x_rms",
    "y_rms",
    "invalid_state",
    "pdh0",
    "vx_rms",
    "vy_rms",
)
MAX_POINTS = 256
"""A scan's IDs are one byte."""

_NAMES = POINT.names or ()
_FIXED = {
    "FIELDS": " ".join(_NAMES),
    "SIZE": " ".join(str(POINT[name].itemsize) for name in _NAMES),
    "TYPE": " ".join("F" if POINT[name].kind == "f" else "I" for name in _NAMES),
    "HEIGHT": "1",
    "DATA": "binary",
}
_STAMP = re.compile(r"__(\d{16})$")
_LONGEST_HEADER = 4096
_FAR_STEP_M = 1.0
"""Ranges within a list step back by less (rounding to the CAN grid); from near to far by more."""


@dataclass(frozen=True, slots=True, eq=False)
class RadarCloud:
    """The content of one file.

    Attributes
    ----------
    points:
        (n,) of ``POINT``. The data set writes an empty cloud as one point that is NaN: n is 0.
    header:
        The header as it stands in the file, its last newline included.
    tail:
        What follows the points. The data set's readers want at least one byte.
    """

    points: NDArray[np.void]
    header: bytes
    tail: bytes

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CloudScan(RadarScan):
    """A scan that knows which points of a cloud its clusters are.

    Attributes
    ----------
    place:
        (n,) uint16, index of the point; of a ghost, the point that lent it its quality.
    """

    place: NDArray[np.uint16]


def new_cloud(points: NDArray[np.void]) -> RadarCloud:
    """Return points of ``POINT`` with a header as the data set writes it."""
    lines = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {_FIXED['FIELDS']}",
        f"SIZE {_FIXED['SIZE']}",
        f"TYPE {_FIXED['TYPE']}",
        f"COUNT {' '.join('1' for _ in _NAMES)}",
        f"WIDTH {len(points)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(points)}",
        "DATA binary",
    ]
    return RadarCloud(points, "\n".join(lines).encode() + b"\n", b"\n")


def read_cloud(path: Path) -> RadarCloud:
    """Read a file.

    Raises
    ------
    InputError
        If it cannot be read, is cut off, or has other fields than ``POINT``.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(path, str(error.strerror).lower(), "expected a PCD file") from error
    header, count = _read_header(path, content)
    there = (len(content) - len(header)) // POINT.itemsize
    if there < count:
        what = f"is cut off: {there} of {count} points"
        raise InputError(path, what, "copy it again from the data set")
    points = np.frombuffer(content, POINT, count, len(header))
    tail = content[len(header) + points.nbytes :]
    return RadarCloud(points[:0] if count and np.isnan(points["x"][0]) else points, header, tail)


def cloud_bytes(cloud: RadarCloud) -> bytes:
    """Return the file that says a cloud; reading it and writing it again changes no byte."""
    points = cloud.points
    if not len(points):
        points = np.zeros(1, POINT)
        for name in _NAMES:
            if POINT[name].kind == "f":
                points[name] = np.nan
    header = re.sub(rb"(?m)^(WIDTH|POINTS) \d+", rb"\1 %d" % len(points), cloud.header)
    return header + points.tobytes() + (cloud.tail or b"\n")


def scan_of(cloud: RadarCloud, sensor: str, sequence: int, path: Path) -> CloudScan:
    """Return a cloud as a scan; ``path`` is for the error and the stamp.

    The stamp is the microseconds that the data set's file names end with; 0 without them.
    Where the near list ends is not in the file: it is told by the range that steps back.

    Raises
    ------
    InputError
        If it has more points than a cycle has IDs.
    """
    points = cloud.points
    if len(points) > MAX_POINTS:
        raise InputError(path, f"{len(points)} points", f"a cycle has at most {MAX_POINTS}")
    near = _near(np.hypot(points["x"], points["y"]))
    columns: dict[str, Any] = {name: points[name].copy() for name in FLOATS}
    columns |= {name: points[name].astype(np.uint8) for name in CODES}
    return CloudScan(
        sensor=sensor,
        sensor_id=0,
        sequence=sequence,
        stamp_ns=_stamp_ns(path),
        stamp_source="file",
        mode="cluster",
        meas_counter=0,
        near=near,
        far=len(points) - near,
        id=np.arange(len(points), dtype=np.uint8),
        place=np.arange(len(points), dtype=np.uint16),
        **columns,
    )


def with_scan(cloud: RadarCloud, scan: CloudScan) -> RadarCloud:
    """Return the cloud with a changed scan's clusters for points.

    What a scan does not say (``z``, ``is_quality_valid``, the compensated velocity) stays that of
    the point at ``place``.
    """
    points = cloud.points[scan.place]
    for name in ("id", *FLOATS, *CODES):
        points[name] = getattr(scan, name)
    return replace(cloud, points=points)


def _stamp_ns(path: Path) -> int:
    stamp = _STAMP.search(path.stem)
    return int(stamp[1]) * 1000 if stamp else 0


def _near(distance: NDArray[np.float32]) -> int:
    if len(distance) < 2:
        return len(distance)
    step = np.diff(distance)
    place = int(np.argmin(step))
    return place + 1 if step[place] < -_FAR_STEP_M else len(distance)


def _read_header(path: Path, content: bytes) -> tuple[bytes, int]:
    """Return the header and how many points it announces."""
    end = re.search(rb"(?m)^DATA .*\n", content[:_LONGEST_HEADER])
    if end is None:
        raise InputError(path, "has no PCD header", "expected a radar file of nuScenes")
    header = content[: end.end()]
    said = {}
    for number, line in enumerate(header.decode("ascii", "replace").splitlines(), start=1):
        key, _, value = line.partition(" ")
        said[key] = value.strip()
        if said[key] != _FIXED.get(key, said[key]):
            raise InputError(f"{path}:{number}", f"{key} {value[:80]}", f"expected {_FIXED[key]}")
    missing = [key for key in (*_FIXED, "WIDTH", "POINTS") if key not in said]
    if missing:
        raise InputError(path, f"has no {missing[0]} in its PCD header")
    if not said["WIDTH"].isdecimal() or said["POINTS"] != said["WIDTH"]:
        what = f"WIDTH {said['WIDTH'][:20]}, POINTS {said['POINTS'][:20]}"
        raise InputError(path, what, "expected the same number of points")
    return header, int(said["WIDTH"])
