"""Jobs on candump logs."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

from dbc.errors import LogError
from drivers.ars408_cycles import Cycle, find_cycles, replace_cycles
from drivers.can_frames import CanFrames, concatenate
from drivers.candump import read_candump, write_candump
from node.dataset.job import Job
from node.interference import states_of, with_interference_told

_FRAMES_A_BATCH = 1 << 14


def degrade(job: Job, path: Path) -> list[dict[str, Any]]:
    """Write the log with every cluster scan degraded and all else as it was; a label a scan.

    But the radar says in its next state (0x201) that there was interference.

    Raises
    ------
    LogError
        If the log cannot be read or holds no cluster scan.
    """
    source = job.source
    frames = concatenate(list(read_candump(source.path)))
    changed, labels, bursts = [], [], []
    for cycle in find_cycles(frames):
        sensor = f"{source.sensor}/{cycle.sensor}"
        scan, label = job.degrade(cycle.scan, sensor, cycle.scan.sequence)
        labels.append(label)
        if job.kind == "interference" and label["drawn"]["ghosts"]:
            bursts.append(cycle)
        if scan is not cycle.scan:
            changed.append((cycle, scan))
    if not labels:
        raise LogError(source.path, "holds no cluster scan", "expected CAN IDs 0x600 and 0x701")
    told = with_interference_told(frames, _states_after(frames, bursts))
    _write(path, replace_cycles(told, changed))
    return labels


def _states_after(frames: CanFrames, cycles: list[Cycle]) -> list[int]:
    """Return the row of the radar's next state after each cycle, where one follows."""
    rows = []
    for cycle in cycles:
        states = states_of(frames, cycle.scan.sensor_id)
        same = frames.channel[states] == frames.channel[cycle.rows[0]]
        rows += states[same & (states > cycle.rows[0])][:1].tolist()
    return rows


def _write(path: Path, frames: CanFrames) -> None:
    """Write a log, compressed where its name says so, without the time of day that gzip adds."""
    plain = path.with_suffix("") if path.suffix == ".gz" else path
    starts = range(0, len(frames), _FRAMES_A_BATCH)
    write_candump(plain, (frames.select(slice(n, n + _FRAMES_A_BATCH)) for n in starts))
    if plain != path:
        path.write_bytes(gzip.compress(plain.read_bytes(), mtime=0))
        plain.unlink()
