"""Estimation of whole files, message by message and unfiltered."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from time import perf_counter_ns

from dbc.errors import InputError
from drivers.camera import open_camera_source
from drivers.frame import Frame
from drivers.scan import RadarScan
from models.estimate.level import Estimate
from node.estimator import load_network
from node.recording import is_recording, open_sensors
from node.scene import SensorType

LOG_SUFFIXES = {".log", ".txt", ".candump", ".asc", ".blf", ".trc", ".mf4", ".db", ".csv"}


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """The estimate of one frame or scan.

    Attributes
    ----------
    source:
        The path that it came from, as it was given; of a recording with the topic.
    sequence, stamp_ns:
        The message's own.
    run_time_us:
        Of the estimate alone, microseconds.
    """

    source: str
    sequence: int
    stamp_ns: int
    estimate: Estimate
    run_time_us: float


def estimate_paths(paths: list[Path]) -> Iterator[Row]:
    """Estimate every frame and cluster scan of images, folders, videos, CAN logs and recordings.

    Raises
    ------
    InputError
        At the first file that cannot be read; what came before has been yielded.
    """
    networks = {}
    for source, sensor_type, messages in chain.from_iterable(map(streams, paths)):
        if sensor_type not in networks:
            networks[sensor_type] = load_network(sensor_type)
        network = networks[sensor_type]
        for message in messages:
            start_ns = perf_counter_ns()
            estimate = network(message)
            run_time_us = (perf_counter_ns() - start_ns) / 1e3
            yield Row(source, message.sequence, message.stamp_ns, estimate, run_time_us)


def streams(path: Path) -> Iterator[tuple[str, SensorType, Iterator[Frame | RadarScan]]]:
    """Yield name, sensor type and messages of each sensor that a path holds."""
    if is_recording(str(path)):
        for sensor, source in open_sensors(path):
            yield sensor.source, sensor.type, source.messages()
    elif _is_log(path):
        yield str(path), "radar", _scans(path)
    else:
        yield str(path), "camera", _frames(path)


def _is_log(path: Path) -> bool:
    return path.suffix.lower() in LOG_SUFFIXES or path.name.lower().endswith(".log.gz")


def _frames(path: Path) -> Iterator[Frame]:
    with open_camera_source(path, path.name) as source:
        yield from source


def _scans(path: Path) -> Iterator[RadarScan]:
    from drivers.ars408 import ScanAssembler
    from drivers.can_log import read_log

    assembler = ScanAssembler()
    found = 0
    for part in chain(map(assembler.feed, read_log(path)), iter([assembler.flush()])):
        for message in part:
            if isinstance(message, RadarScan) and message.mode == "cluster":
                found += 1
                yield message
    if not found:
        raise InputError(path, "holds no cluster scan", "expected CAN IDs 0x600 and 0x701")
