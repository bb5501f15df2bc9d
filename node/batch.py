"""Estimation of whole files, message by message and unfiltered."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, groupby
from pathlib import Path
from time import perf_counter_ns
from typing import Any

from dbc.errors import InputError, ModelError, VideoError, and_others
from drivers.camera import natural_key, open_camera_source
from drivers.frame import Frame
from drivers.scan import RadarScan
from models.estimate.level import Estimate
from node.dataset.sources import Source, find_sources
from node.estimator import load_follower, load_network
from node.recording import is_recording, open_sensors
from node.scene import SensorType

Message = Frame | RadarScan
Network = Callable[[Any], Estimate]

LOG_SUFFIXES = {".log", ".txt", ".candump", ".asc", ".blf", ".trc", ".mf4", ".db", ".csv"}

_IMAGE_PERIOD_NS = 100_000_000
"""Images have no time of their own."""


@dataclass(frozen=True, slots=True)
class Part:
    """One file to read.

    Attributes
    ----------
    sequence:
        Number of a single image or scan among those of its folder; None of a file given by itself
        or of many messages.
    """

    path: Path
    sequence: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """The estimate of one frame or scan.

    Attributes
    ----------
    source:
        The file that it came from, below the path that was given; of a recording with the topic.
    group:
        The folder of single images and scans, else the source.
    sensor:
        The message's own: a log may hold several.
    sequence, stamp_ns:
        The message's own; single images and scans are counted in their folder.
    run_time_us:
        Of the estimate alone, microseconds.
    """

    source: str
    group: str
    sensor: str
    sequence: int
    stamp_ns: int
    estimate: Estimate
    run_time_us: float


def estimate_paths(paths: list[Path], *, window: bool = False) -> Iterator[Row]:
    """Estimate every frame and cluster scan of images, videos, CAN logs, recordings and folders.

    A frame of a video or a recording is estimated with the history of that camera's exposure.

    Parameters
    ----------
    window:
        Whether a radar's scan is estimated with those before it, instead of by itself.

    Raises
    ------
    InputError
        At the end, where something could not be read; everything else has been yielded.
    """
    networks = _Networks(window)
    failures: list[InputError] = []
    for path in paths:
        with _kept(failures):
            for part in parts(path):
                with _kept(failures):
                    for source, sensor_type, messages in streams(part):
                        yield from _rows(part, source, networks, sensor_type, messages)
    if failures:
        first = failures[0]
        others = and_others([failure.where for failure in failures[1:]])
        raise type(first)(first.where, first.what + others, first.remedy)


@contextmanager
def _kept(failures: list[InputError]) -> Iterator[None]:
    try:
        yield
    except ModelError:
        raise  # no other file would fare better
    except InputError as error:
        failures.append(error)


class _Networks:
    """The networks that are needed: one for each sensor whose messages are taken in a row."""

    def __init__(self, window: bool) -> None:
        self._window = window
        self._alone: dict[SensorType, Network] = {}
        self._following: dict[str, Network] = {}
        self._group = ""

    def of(self, sensor_type: SensorType, group: str, sensor: str, successive: bool) -> Network:
        """Return the network for the messages of one sensor.

        Images of a folder may come from anywhere: they are not ``successive``, none has a history.
        """
        if not (self._window if sensor_type == "radar" else successive):
            if sensor_type not in self._alone:
                self._alone[sensor_type] = load_network(sensor_type)
            return self._alone[sensor_type]
        if group != self._group:
            self._group, self._following = group, {}
        if sensor not in self._following:
            self._following[sensor] = load_follower(sensor_type)
        return self._following[sensor]


def _rows(
    part: Part,
    source: str,
    networks: _Networks,
    sensor_type: SensorType,
    messages: Iterator[Message],
) -> Iterator[Row]:
    group = source if part.sequence is None else str(part.path.parent)
    for message in messages:
        network = networks.of(sensor_type, group, message.sensor, part.sequence is None)
        start_ns = perf_counter_ns()
        estimate = network(message).with_lens()
        run_time_us = (perf_counter_ns() - start_ns) / 1e3
        yield Row(
            source, group, message.sensor, message.sequence, message.stamp_ns, estimate, run_time_us
        )


def parts(path: Path) -> Iterator[Part]:
    """Yield what a path names: itself, or all that a folder and its folders hold.

    Raises
    ------
    InputError
        If the folder cannot be read or holds nothing that is understood.
    """
    if not path.is_dir():
        yield Part(path)
        return
    found, _ = find_sources(path)
    for (place, single), sources in groupby(sorted(found, key=_place), key=_place):
        below = path / place.relative_to(path.absolute())
        if not single:
            yield Part(below)
            continue
        files = sorted({source.path.name for source in sources}, key=natural_key)
        for sequence, name in enumerate(files):
            yield Part(below / name, sequence)


def _place(source: Source) -> tuple[Path, bool]:
    """Return the folder of a single image or scan, else the file; and whether it is single."""
    single = source.form in ("image", "cloud")
    return source.path.parent if single else source.path, single


def streams(part: Part) -> Iterator[tuple[str, SensorType, Iterator[Message]]]:
    """Yield name, sensor type and messages of each sensor that a file holds."""
    path, sequence = part.path, part.sequence or 0
    if is_recording(str(path)):
        for sensor, source in open_sensors(path):
            yield sensor.source, sensor.type, source.messages()
    elif path.suffix.lower() == ".pcd":
        yield str(path), "radar", _cloud(path, sequence)
    elif part.sequence is not None:
        yield str(path), "camera", _image(path, sequence)
    elif _is_log(path):
        yield str(path), "radar", _scans(path)
    else:
        yield str(path), "camera", _frames(path)


def _image(path: Path, sequence: int) -> Iterator[Frame]:
    from drivers.images import read_image

    image = read_image(path)
    if image is None:
        raise VideoError(path, "cannot be decoded", "expected an image")
    yield Frame(image, path.parent.name, sequence, sequence * _IMAGE_PERIOD_NS, "file", 0)


def _cloud(path: Path, sequence: int) -> Iterator[RadarScan]:
    from drivers.nuscenes import read_cloud, scan_of

    yield scan_of(read_cloud(path), path.parent.name, sequence, path)


def _is_log(path: Path) -> bool:
    return path.suffix.lower() in LOG_SUFFIXES or path.name.lower().endswith(".log.gz")


def _frames(path: Path) -> Iterator[Frame]:
    with open_camera_source(path, path.name) as source:
        yield from source
        if source.dropped:
            what = f"{source.dropped} of its frames are damaged or missing"
            raise VideoError(path, what, "copy the file again")


def _scans(path: Path) -> Iterator[RadarScan]:
    from drivers.ars408 import ScanAssembler
    from drivers.can_log import read_log

    assembler = ScanAssembler()
    found = objects = 0
    for part in chain(map(assembler.feed, read_log(path)), iter([assembler.flush()])):
        for message in part:
            if not isinstance(message, RadarScan):
                continue
            if message.mode == "cluster":
                found += 1
                yield message
            else:
                objects += 1
    if not found:
        what = "holds objects, no clusters" if objects else "holds no cluster scan"
        raise InputError(path, what, "the noise level needs clusters (CAN IDs 0x600, 0x701)")
