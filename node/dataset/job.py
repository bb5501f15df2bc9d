"""One job: one file degraded by one kind at one level, complete or not there."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any
from uuid import uuid4

from dbc.errors import InputError
from models.degrade.draw import DrawKey
from models.degrade.kinds import module_of
from node.dataset.depth import read_depth_map
from node.dataset.sources import SENSOR_TYPE, Source

STATE = ".murk"
"""Folder in the output that holds how far a run is."""


@dataclass(frozen=True, slots=True)
class Job:
    """One file, kind and level.

    Attributes
    ----------
    source:
        The file.
    kind, level:
        What is done to it, %.
    seed:
        Of the run.
    output:
        The folder of the whole run, absolute.
    target:
        The degraded file, relative to ``output``, with ``/``.
    options:
        What else the drawing takes, by name.
    depth:
        The image's depth map, for weather.
    """

    source: Source
    kind: str
    level: float
    seed: int
    output: Path
    target: str
    options: Mapping[str, Any] = field(default_factory=dict)
    depth: Path | None = None

    @property
    def labels(self) -> Path:
        """The job's own labels, below a line that says of what: where they are, the job is done."""
        return self.output / STATE / "labels" / f"{self.target}.jsonl"

    def origin(self) -> dict[str, Any]:
        """Return what shows that the source, or its depth map, is another one than it was.

        Where files came or went since, a single image or scan has another number.

        Raises
        ------
        OSError
            If one of them is gone.
        """
        stats = [path.stat() for path in (self.source.path, self.depth) if path]
        sizes_and_times = [[stat.st_size, stat.st_mtime_ns] for stat in stats]
        return {"sequence": self.source.sequence, "sizes_and_times": sizes_and_times}

    def is_done(self) -> bool:
        """Tell whether file and labels are there, and are of this job and of what is there now."""
        if not (self.output / self.target).exists():
            return False
        try:
            with self.labels.open(encoding="utf-8") as file:
                return bool(json.loads(file.readline()) == self.origin())
        except FileNotFoundError:
            return False

    def degrade(self, data: Any, sensor: str, sequence: int) -> tuple[Any, dict[str, Any]]:
        """Degrade one image or scan; return it and its label.

        Where nothing happens to it (level 0) it comes back itself.
        """
        module = module_of(SENSOR_TYPE[self.source.form], self.kind)
        key = DrawKey(self.seed, sensor, sequence)
        drawn = module.draw(self.kind, self.level, key, **self.options)
        label = {
            "file": self.target,
            "sensor": sensor,
            "sequence": sequence,
            "kind": self.kind,
            "level": self.level,
            "seed": self.seed,
            "drawn": asdict(drawn),
        }
        if self.depth is None:
            return module.apply(drawn, data), label
        depth_m = read_depth_map(self.depth, data.shape[:2])
        return module.apply(drawn, data, depth_m=depth_m), label


@dataclass(frozen=True, slots=True)
class Done:
    """What a finished job says of itself.

    Attributes
    ----------
    messages:
        Images or scans that it degraded.
    run_time_s:
        Seconds.
    """

    job: Job
    messages: int
    run_time_s: float


def run_job(job: Job) -> Done:
    """Do a job. A file appears under its name only when it is complete, its labels after it.

    Raises
    ------
    InputError
        If the source cannot be read or the target cannot be written.
    """
    start = time.perf_counter()
    form = import_module(f"node.dataset.{job.source.form.partition('_')[0]}")
    target = job.output / job.target
    try:
        origin = job.origin()
        labels = _into_place(target, lambda path: form.degrade(job, path), job.output)
        lines = [origin, *labels]
        text = "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines)
        _into_place(job.labels, lambda path: path.write_text(text, encoding="utf-8"), job.output)
    except OSError as error:
        where = error.filename or target
        raise InputError(
            where, str(error.strerror).lower(), "make room or choose another"
        ) from None
    return Done(job, len(labels), time.perf_counter() - start)


def _into_place(target: Path, write: Callable[[Path], Any], output: Path) -> Any:
    """Let ``write`` make a file elsewhere in the same file system, then give it its name."""
    unfinished = output / STATE / "unfinished" / f"{uuid4().hex}{target.suffix}"
    unfinished.parent.mkdir(parents=True, exist_ok=True)
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        result = write(unfinished)
        unfinished.replace(target)
    finally:
        unfinished.unlink(missing_ok=True)
    return result
