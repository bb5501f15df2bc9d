"""The files of a data set that can be degraded, and what each of them is."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Literal

from dbc.errors import InputError
from drivers.camera import IMAGE_SUFFIXES, VIDEO_SUFFIXES, natural_key
from drivers.can_log import CANDUMP_SUFFIXES
from node.recording import is_recording, sensor_topics
from node.scene import SensorType

Form = Literal["image", "video", "log", "cloud", "mcap_frames", "mcap_scans"]

SENSOR_TYPE: dict[Form, SensorType] = {
    "image": "camera",
    "video": "camera",
    "log": "radar",
    "cloud": "radar",
    "mcap_frames": "camera",
    "mcap_scans": "radar",
}
"""Sensor type by form: it decides which kinds a file can have."""

_RECORDED: tuple[Form, ...] = ("mcap_frames", "mcap_scans")
MESSAGES = ("video", "log", *_RECORDED)
"""Forms of files that hold many messages."""


_UNDERSTOOD = "a video, images, candump logs, MCAP, or nuScenes (samples/CAM_*, samples/RADAR_*)"
_AMBIGUOUS = ".txt"
"""In a folder such a file is rather a readme than a log."""
_NUSCENES_PARTS = ("samples", "sweeps")
_NUSCENES_SENSORS = ("CAM_", "RADAR_")


@dataclass(frozen=True, slots=True)
class Source:
    """One file to be degraded.

    Attributes
    ----------
    path:
        The file, absolute.
    target:
        Where its copy belongs below the folder of its kind and level, with ``/``.
    form:
        What it is.
    sensor, sequence:
        For the draws: the sensor's name, and of a single image or scan its number. A file of many
        messages is a sensor of its own; single ones are the messages of one sensor a folder, by
        name, and in nuScenes of one a channel, samples and sweeps together.
    """

    path: Path
    target: str
    form: Form
    sensor: str
    sequence: int = 0


def find_sources(path: Path) -> tuple[list[Source], int]:
    """Find what is to be degraded in a file or, recursively, in a folder.

    Hidden files are passed over.

    Returns
    -------
    list of Source
        Sorted by path. Links to folders are not followed.
    int
        How many other files the folder holds.

    Raises
    ------
    InputError
        If the path cannot be read or holds nothing that is understood.
    """
    path = path.absolute()
    if not path.exists():
        raise InputError(path, "no such file or folder", f"expected {_UNDERSTOOD}")
    if not path.is_dir():
        forms = _forms(path, alone=True)
        if not forms:
            raise InputError(path, f"{path.suffix or 'a file without suffix'} is not understood",
                             f"expected {_UNDERSTOOD}")  # fmt: skip
        return [Source(path, _target(path.name, form), form, path.name) for form in forms], 0
    in_nuscenes = _is_nuscenes(path)
    files = [name for name in _walk(path) if not in_nuscenes or _is_of_sensor(name)]
    known = {name: forms for name in files if (forms := _forms(path / name, alone=False))}
    if not known:
        raise InputError(path, "holds nothing that is understood", f"expected {_UNDERSTOOD}")
    counts = Counter[tuple[str, Form]]()
    sources = []
    for name in sorted(known, key=lambda name: natural_key(PurePosixPath(name).name)):
        for form in known[name]:
            sensor, sequence = name, 0
            if form not in MESSAGES:
                sensor = _folder(path, name, in_nuscenes)
                sequence = counts[sensor, form]
                counts[sensor, form] += 1
            sources.append(Source(path / name, _target(name, form), form, sensor, sequence))
    return sorted(sources, key=lambda source: source.path), len(files) - len(known)


def _folder(path: Path, name: str, in_nuscenes: bool) -> str:
    """Return the sensor's name of a single image or scan: its channel, or its folder."""
    parts = PurePosixPath(name).parts
    if in_nuscenes:
        return parts[1]
    return "/".join(parts[:-1]) or path.name


def _walk(folder: Path) -> list[str]:
    """Return all files below a folder, sorted, relative to it, with ``/``."""

    def visible() -> Iterator[str]:
        for place, folders, files in os.walk(folder, onerror=_refuse):
            folders[:] = [name for name in folders if not name.startswith(".")]
            for name in files:
                if not name.startswith("."):
                    yield _checked((Path(place) / name).relative_to(folder).as_posix())

    return sorted(visible())


def _checked(name: str) -> str:
    try:
        name.encode()
    except UnicodeEncodeError:
        raise InputError(ascii(name), "the name is not UTF-8", "rename it") from None
    return name


def _refuse(error: OSError) -> None:
    raise InputError(error.filename, str(error.strerror).lower(), "expected a readable folder")


def _is_nuscenes(folder: Path) -> bool:
    return any((folder / "samples").glob("CAM_*")) or any((folder / "samples").glob("RADAR_*"))


def _is_of_sensor(name: str) -> bool:
    """Whether a file of nuScenes is of a camera or a radar; maps and lidar are of none."""
    part, _, rest = name.partition("/")
    return part in _NUSCENES_PARTS and rest.startswith(_NUSCENES_SENSORS)


def _forms(path: Path, *, alone: bool) -> tuple[Form, ...]:
    """Return what a file is: of a recording, a form for each type of its sensors.

    A damaged recording in a folder may be of any: its jobs say what is wrong with it.
    """
    if not is_recording(path.name):
        form = _form(path.name, alone=alone)
        return () if form is None else (form,)
    from node.bus.mcap_reader import open_mcap

    try:
        there = set(sensor_topics(open_mcap(path)).values())
    except InputError:
        if alone:
            raise
        return _RECORDED
    return tuple(form for form in _RECORDED if SENSOR_TYPE[form] in there)


def _form(name: str, *, alone: bool) -> Form | None:
    path = Path(name.lower())
    suffix = Path(path.stem).suffix if path.suffix == ".gz" else path.suffix
    if suffix in CANDUMP_SUFFIXES and (alone or suffix != _AMBIGUOUS):
        return "log"
    if path.suffix in IMAGE_SUFFIXES:
        return "image"
    if path.suffix in VIDEO_SUFFIXES:
        return "video"
    return "cloud" if path.suffix == ".pcd" else None


def _target(name: str, form: Form) -> str:
    """Return the copy's name: a video becomes an MP4 file, everything else stays what it is."""
    is_other_video = form == "video" and not name.lower().endswith(".mp4")
    return f"{name}.mp4" if is_other_video else name
