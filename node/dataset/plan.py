"""The jobs of a run, and what must hold before the first of them starts."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

from dbc.errors import InputError, SceneError
from models.degrade.checks import check_within
from models.degrade.draw import DrawKey
from models.degrade.kinds import HAZY, KINDS, OPTIONS, module_of, options_of
from node.dataset.depth import find_depth_map
from node.dataset.job import STATE, Job
from node.dataset.sources import SENSOR_TYPE, Source, find_sources

ALL_LEVELS = tuple(float(level) for level in range(0, 101, 10))

_SETTINGS = "settings.json"


@dataclass(frozen=True, slots=True)
class Plan:
    """A run.

    Attributes
    ----------
    jobs:
        In the order of the labels.
    output:
        Absolute.
    ignored:
        Files of the input that are neither images, videos nor radar data.
    settings:
        What the output depends on.
    """

    jobs: list[Job]
    output: Path
    ignored: int
    settings: dict[str, Any]


def make_plan(
    source: Path,
    output: Path,
    kinds: Sequence[str],
    levels: Sequence[float],
    seed: int,
    *,
    options: Mapping[str, Any] | None = None,
    depth: Path | None = None,
) -> Plan:
    """List the jobs and check that nothing that is there already would be overwritten.

    Parameters
    ----------
    source:
        A file or a folder.
    output:
        Folder for the degraded files: new, empty, or of a run with the same settings. Where there
        is more than one pair of kind and level, each pair has a folder ``<kind>_<level>`` in it.
    kinds, levels:
        Every kind at every level (%); no kinds: every kind of the sensors that the input has.
    options:
        What else the drawing of these kinds takes, by name: see ``models.degrade.kinds.OPTIONS``.
    depth:
        For weather: a folder with a depth map for each image, at the same place as the image.

    Raises
    ------
    SceneError
        If a kind, a level or an option is none, or no file of the input can have a kind.
    InputError
        If the input holds nothing to degrade, an image has no depth map, or the output cannot be
        used.
    """
    sources, ignored = find_sources(source)
    wanted = _check_kinds(sources, list(dict.fromkeys(kinds)))
    levels = list(dict.fromkeys(levels))
    for level in levels:
        check_within("--level", level, 0.0, 100.0, "%")
    options = dict(sorted((options or {}).items()))
    _check_options(wanted, options, seed)
    output = output.resolve()
    pairs = [(kind, level) for kind in wanted for level in levels]
    jobs = [
        Job(
            source=file,
            kind=kind,
            level=level,
            seed=seed,
            output=output,
            target=_target(file, kind, level, len(pairs) > 1),
            options=options_of(kind, options),
            depth=find_depth_map(depth.absolute(), file) if depth and kind in HAZY else None,
        )
        for kind, level in pairs
        for file in sources
        if kind in KINDS[SENSOR_TYPE[file.form]]
    ]
    settings = {
        "murk": version("murk"),
        "input": str(source.resolve()),
        "kinds": wanted,
        "levels": levels,
        "seed": seed,
        "options": options,
        "depth": str(depth.resolve()) if depth else None,
    }
    _check_places(source.resolve(), output, jobs)
    _check_output(output, settings)
    return Plan(jobs, output, ignored, settings)


def begin(plan: Plan) -> list[Job]:
    """Write down the settings in the output; return the jobs that are still to be done.

    Raises
    ------
    InputError
        If the output cannot be written.
    """
    path = plan.output / STATE / _SETTINGS
    try:
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            unfinished = path.with_suffix(".part")
            unfinished.write_text(json.dumps(plan.settings) + "\n", encoding="utf-8")
            unfinished.replace(path)
    except OSError as error:
        raise InputError(plan.output, str(error.strerror).lower(), "choose another") from None
    return [job for job in plan.jobs if not job.is_done()]


@contextmanager
def alone_in(output: Path) -> Iterator[None]:
    """Keep other runs out of an output that ``begin`` has begun; a killed one keeps nobody out.

    Raises
    ------
    InputError
        If another run is at work there.
    """
    try:
        held = (output / STATE / _SETTINGS).open("r+")  # NFS locks what is open for writing
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        held.close()
        raise InputError(output, "another run is at work there", "wait for its end") from None
    except OSError as error:
        raise InputError(output, str(error.strerror).lower(), "choose another") from None
    with held:
        yield


def _check_kinds(sources: list[Source], kinds: list[str]) -> list[str]:
    types = {SENSOR_TYPE[source.form] for source in sources}
    known = [kind for sensor_type in KINDS for kind in KINDS[sensor_type] if sensor_type in types]
    for kind in kinds:
        if kind not in known:
            there = " and ".join(sorted(types))
            raise SceneError("--kind", f"the input has no {kind!r}", f"{there}: {', '.join(known)}")
    return kinds or known


def _check_options(kinds: list[str], options: dict[str, Any], seed: int) -> None:
    """Draw each kind once with what it is given: its ``draw`` says what is wrong with a value."""
    for name in options:
        taking = OPTIONS.get(name, ())
        if not taking:
            raise SceneError(f"option {name!r}", "unknown", f"one of {', '.join(OPTIONS)}")
        if not set(taking) & set(kinds):
            raise SceneError(f"option {name!r}", "has no effect", f"it is of {', '.join(taking)}")
    for sensor_type, kind in product(KINDS, kinds):
        given = options_of(kind, options)
        if given and kind in KINDS[sensor_type]:
            try:
                module_of(sensor_type, kind).draw(kind, 0.0, DrawKey(seed, "", 0), **given)
            except TypeError:
                raise SceneError(f"option of {kind}", f"{given}", "a value of its type") from None


def _target(source: Source, kind: str, level: float, several: bool) -> str:
    return f"{kind}_{level:g}/{source.target}" if several else source.target


def _check_places(source: Path, output: Path, jobs: list[Job]) -> None:
    """Refuse an output that would touch its input, and two files that would become one."""
    if output == source or source in output.parents:
        raise InputError(output, "lies in the input", "choose a folder outside it")
    originals = {path.resolve() for path in {job.source.path for job in jobs}}
    taken = set()
    for job in jobs:
        target = (output / job.target).resolve()
        if target in originals:
            raise InputError(target, "would be overwritten and is input", "choose another folder")
        if target in taken:
            raise InputError(job.source.path, "has the target of another file", "rename one")
        taken.add(target)


def _check_output(output: Path, settings: dict[str, Any]) -> None:
    """Refuse a folder of other content or of a run with other settings."""
    path = output / STATE / _SETTINGS
    try:
        if path.exists():
            there = json.loads(path.read_text(encoding="utf-8"))
        elif output.exists() and any(output.iterdir()):
            raise InputError(output, "is not empty", "choose a new folder")
        else:
            return
    except OSError as error:
        raise InputError(output, str(error.strerror).lower(), "expected a folder") from None
    except ValueError:
        raise InputError(path, "is not murk's", "choose a new folder") from None
    for name, value in settings.items():
        before = there.get(name) if isinstance(there, dict) else None
        if before != value:
            what = f"holds a run with {name} {before!r}, not {value!r}"
            raise InputError(output, what, "choose a new folder")
