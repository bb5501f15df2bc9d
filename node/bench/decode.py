"""What it costs to decode radar frames: one at a time, many at once, and a whole log.

Run times are CPU time a frame; errors are the largest difference to what cantools decodes. The
logs are simulated: random scans on a full bus, with a radar state a second. All rivals take turns
in one process.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import cantools.database
import numpy as np
from can import Message
from can.io.canutils import CanutilsLogReader
from cantools.database.can import Database as ParsedDatabase

import dbc.codec
from dbc.codec import ars408
from drivers.ars408 import Item, ScanAssembler
from drivers.ars408_layout import CLUSTER_MODE
from drivers.can_frames import CanFrames, concatenate
from drivers.candump import read_candump, write_candump
from drivers.encode import encode_scan, encode_state
from drivers.scan import RadarScan, RadarState
from models.evaluate.report import Goal, Point
from node.memory import keep_freed_memory

Task = Callable[[], Any]

SCAN_FRAMES = 250
BATCHES = (1, 10, 50, 125, SCAN_FRAMES, 1000, 10_000)
CYCLE_NS = 72_000_000
CYCLES_PER_STATE = 14
CHUNK_BYTES = 1 << 20
UNIT = "largest difference to cantools"


def run(quick: bool) -> Iterator[Point | Goal]:
    """Measure the codec over batch sizes, and candump logs to scans, against cantools."""
    keep_freed_memory()
    parsed = parsed_database()
    yield from codec_results(parsed, rounds=15 if quick else 45)
    with TemporaryDirectory() as folder:
        log = Path(folder) / "radar.log"
        for clusters, quality in ((250, False), (120, True)):
            frames = simulated_log(clusters, quality, cycles=150 if quick else 300)
            name = f"{clusters} clusters a scan" + (", quality" if quality else "")
            yield from log_results(parsed, log, frames, name, rounds=5 if quick else 9)


def parsed_database() -> ParsedDatabase:
    """Return the radar's database as cantools reads it."""
    parsed = cantools.database.load_file(Path(dbc.codec.__file__).with_name("ars408.dbc"))
    assert isinstance(parsed, ParsedDatabase)
    return parsed


def codec_results(parsed: ParsedDatabase, rounds: int) -> Iterator[Point | Goal]:
    """Measure one message, cantools frame by frame against the codec at every batch size."""
    codec = ars408().message("Cluster_1_General")
    message = parsed.get_message_by_name(codec.name)
    payloads = np.random.default_rng(0).integers(0, 256, (max(BATCHES), 8), dtype=np.uint8)
    frames = [payload.tobytes() for payload in payloads[:SCAN_FRAMES]]

    def reference() -> list[Any]:
        return [message.decode(frame, decode_choices=False) for frame in frames]

    truth, ours = reference(), codec.decode(payloads[:SCAN_FRAMES])
    error = max(
        float(np.abs(column - [values[name] for values in truth]).max())
        for name, column in ours.items()
    )
    tasks: dict[int, Task] = {n: partial(codec.decode, payloads[:n]) for n in BATCHES}
    times = _interleaved({0: reference, **tasks}, rounds)
    yield Point("cantools", "batch=1", median(times[0]) / SCAN_FRAMES, 0.0, UNIT)
    for n in BATCHES:
        yield Point("codec", f"batch={n}", median(times[n]) / n, error, UNIT)
    ratio = _ratio(times[0], times[SCAN_FRAMES])
    yield Goal("decode a 250-cluster scan, times cantools per frame", ratio, 50.0)


def log_results(
    parsed: ParsedDatabase, log: Path, frames: CanFrames, name: str, rounds: int
) -> Iterator[Point | Goal]:
    """Write frames to a log and measure what it costs to read it back to scans."""
    write_candump(log, [frames])
    error = largest_difference(scans_of_log(log), decoded_by_python_can(log, parsed))
    tasks: dict[str, Task] = {
        "python-can reader": partial(_read_by_python_can, log),
        "python-can reader and cantools": partial(decoded_by_python_can, log, parsed),
        "candump reader": partial(_read, log),
        "candump log to scans": partial(scans_of_log, log),
    }
    times = _interleaved(tasks, rounds)
    for variant in tasks:
        yield Point(variant, name, median(times[variant]) / len(frames), error, UNIT)
    ratio = _ratio(times["python-can reader and cantools"], times["candump log to scans"])
    yield Goal(f"candump log to scans ({name}), times python-can and cantools", ratio, 20.0)


def simulated_log(clusters: int, quality: bool, cycles: int) -> CanFrames:
    """Return the frames of random scans, with a radar state before every 14th."""
    rng = np.random.default_rng(clusters)
    state = {"RadarState_SendQualityCfg": float(quality)}
    batches = []
    for number in range(cycles):
        stamp_ns = number * CYCLE_NS
        if number % CYCLES_PER_STATE == 0:
            batches.append(encode_state(RadarState("", 0, stamp_ns, state)))
        batches.append(encode_scan(_random_scan(rng, clusters, quality, number)))
    return concatenate(batches)


def _random_scan(rng: np.random.Generator, n: int, quality: bool, number: int) -> RadarScan:
    arrays: dict[str, Any] = {}
    for layout in CLUSTER_MODE.lists if quality else [CLUSTER_MODE.general]:
        arrays |= layout.decode(rng.integers(0, 256, (n, 8), dtype=np.uint8))
    arrays["id"] = np.arange(n, dtype=np.uint8)
    return RadarScan(
        sensor="radar_0",
        sensor_id=0,
        sequence=number,
        stamp_ns=number * CYCLE_NS,
        stamp_source="simulated",
        mode="cluster",
        meas_counter=2 * number,
        near=n // 2,
        far=n - n // 2,
        **arrays,
    )


def _read_by_python_can(path: Path) -> list[Message]:
    with CanutilsLogReader(path) as reader:
        return list(reader)


def decoded_by_python_can(path: Path, parsed: ParsedDatabase) -> list[Any]:
    """Return the signals of every frame of a log, by python-can's reader and cantools."""
    with CanutilsLogReader(path) as reader:
        return [
            parsed.decode_message(message.arbitration_id, message.data, decode_choices=False)  # type: ignore[arg-type]
            for message in reader
        ]


def _read(path: Path) -> list[CanFrames]:
    return list(read_candump(path, CHUNK_BYTES))


def scans_of_log(path: Path) -> list[RadarScan]:
    """Return the scans of a log, by our reader and assembler."""
    assembler = ScanAssembler()
    items: list[Item] = []
    for frames in read_candump(path, CHUNK_BYTES):
        items += assembler.feed(frames)
    items += assembler.flush()
    return [item for item in items if isinstance(item, RadarScan)]


def largest_difference(scans: list[RadarScan], decoded: list[dict[str, Any]]) -> float:
    """Return the largest difference between scans and the frames decoded one by one."""
    worst = 0.0
    for layout in CLUSTER_MODE.lists:
        frames = [values for values in decoded if values.keys() == set(layout.codec.signals)]
        for field, signal in layout.fields.items():
            parts = [getattr(scan, field) for scan in scans if getattr(scan, field) is not None]
            if parts:
                ours = np.concatenate(parts)
                truth = np.array([values[signal] for values in frames]).astype(ours.dtype)
                worst = max(worst, float(np.abs(ours - truth).max()))
    return worst


def _interleaved(tasks: Mapping[Any, Task], rounds: int) -> dict[Any, list[float]]:
    """Return the CPU time of every round, us, of tasks that take turns: all meet the same load."""
    times: dict[Any, list[float]] = {name: [] for name in tasks}
    repeats = {name: max(1, round(2e-3 / _cpu_s(task, 2))) for name, task in tasks.items()}
    for _ in range(rounds):
        for name, task in tasks.items():
            times[name].append(_cpu_s(task, repeats[name]) * 1e6)
    return times


def _cpu_s(task: Task, repeats: int) -> float:
    start = process_time()
    for _ in range(repeats):
        task()
    return (process_time() - start) / repeats


def _ratio(slow: list[float], fast: list[float]) -> float:
    return median(a / b for a, b in zip(slow, fast, strict=True))
