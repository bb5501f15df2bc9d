"""``murk degrade``: degraded copies of data sets, with labels, and sheets that show the kinds."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from models.degrade.kinds import KINDS
from node.cli.output import emit, plain_console

if TYPE_CHECKING:
    from node.dataset.job import Done, Job
    from node.dataset.plan import Plan


def degrade(
    source: Annotated[
        Path | None,
        typer.Argument(metavar="INPUT", help="Image, video, candump log, MCAP, or a folder."),
    ] = None,
    output: Annotated[
        Path | None, typer.Argument(metavar="OUTPUT", help="Folder, new or half done.")
    ] = None,
    kind: Annotated[
        list[str] | None,
        typer.Option(
            help="; ".join(f"{sensor}: {', '.join(kinds)}" for sensor, kinds in KINDS.items())
            + ". Repeatable.",
            metavar="KIND",
        ),
    ] = None,
    level: Annotated[
        list[float] | None, typer.Option(help="0 to 100 %; repeatable.", metavar="N")
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Every kind of the input's sensors at 0, 10, … 100 %.")
    ] = False,
    seed: Annotated[int, typer.Option(help="The same seed gives the same bytes.")] = 1,
    horizon: Annotated[
        float | None,
        typer.Option(help="For weather: share of the image above the horizon.", metavar="N"),
    ] = None,
    depth: Annotated[
        Path | None,
        typer.Option(help="For weather: folder of depth maps.", metavar="FOLDER"),
    ] = None,
    option: Annotated[
        list[str] | None,
        typer.Option(
            "--with",
            help="Repeatable: snr_drop_db=20, quality=consistent, ghost_life=5, std_max=50, "
            "method=published.",
            metavar="NAME=VALUE",
        ),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Dask scheduler instead of this machine.", metavar="TCP")
    ] = None,
    sheet: Annotated[
        bool,
        typer.Option("--sheet", help="Only pictures of every kind, into OUTPUT, else docs/."),
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="A JSON object a file; a summary.")] = False,
) -> None:
    """Write degraded copies of a data set, and labels.csv and labels.jsonl that say what was done.

    Give the same command again to go on after a kill: what is complete is not done twice.
    """
    from dbc.errors import SceneError
    from node.dataset.plan import ALL_LEVELS, make_plan

    if sheet:
        _draw_sheets(source, output or Path("docs"), seed, json=json)
        return
    if source is None or output is None:
        raise SceneError("degrade", "needs INPUT and OUTPUT", "or --sheet")
    if every and (kind or level):
        raise SceneError("--all", "is every kind at every level", "leave out --kind and --level")
    if not every and not (kind and level):
        raise SceneError("degrade", "needs --kind and --level", "or --all")
    options = dict(map(_option, option or []))
    if horizon is not None:
        options["horizon"] = horizon
    plan = make_plan(
        source, output, kind or [], level or ALL_LEVELS, seed, options=options, depth=depth
    )
    _run(plan, scheduler, json=json)


def _option(text: str) -> tuple[str, int | float | str]:
    """Return name and value; a value that reads as a number is one."""
    name, _, value = text.partition("=")
    for number in (int, float):
        with suppress(ValueError):
            return name, number(value)
    return name, value


def _run(plan: Plan, scheduler: str | None, *, json: bool) -> None:
    from node.dataset.plan import alone_in, begin

    jobs = begin(plan)
    with alone_in(plan.output):
        _do(plan, jobs, scheduler, json=json)


def _do(plan: Plan, jobs: list[Job], scheduler: str | None, *, json: bool) -> None:
    from dbc.errors import InputError
    from node.dataset.labels import write_labels
    from node.dataset.workers import dask_workers, do_jobs, local_workers

    finished = messages = 0
    complete = False
    try:
        with dask_workers(scheduler) if scheduler else local_workers() as executor:
            for done in _shown(do_jobs(jobs, executor), len(jobs), json=json):
                finished += 1
                messages += done.messages
        write_labels(plan)
        complete = True
    except InputError:
        with suppress(InputError):
            write_labels(plan)  # of all but the bad files
        raise
    finally:
        summary = {
            "type": "summary",
            "output": str(plan.output),
            "complete": complete,
            "files": finished,
            "messages": messages,
            "skipped": len(plan.jobs) - len(jobs),
            "left": len(jobs) - finished,
            "ignored": plan.ignored,
        }
        if json:
            emit(summary)
        else:
            _print(summary)


def _shown(done: Iterable[Done], total: int, *, json: bool) -> Iterator[Done]:
    """Pass on what is done: as a line each, or as a progress bar on a terminal."""
    if json:
        for one in done:
            emit(
                {
                    "type": "file",
                    "file": one.job.target,
                    "kind": one.job.kind,
                    "level": one.job.level,
                    "messages": one.messages,
                    "run_time_s": round(one.run_time_s, 4),
                }
            )
            sys.stdout.flush()
            yield one
        return
    with _progress(total) as advance:
        for one in done:
            advance()
            yield one


@contextmanager
def _progress(total: int) -> Iterator[Callable[[], None]]:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    console = plain_console(stderr=True)
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=total)
        yield lambda: progress.advance(task)


def _print(summary: dict[str, object]) -> None:
    left = "" if summary["complete"] else f"; {summary['left']:,} left: give the command again"
    plain_console().print(
        f"{summary['files']:,} files ({summary['messages']:,} images and scans) in "
        f"{summary['output']}, {summary['skipped']:,} were there, "
        f"{summary['ignored']:,} ignored{left}",
        highlight=False,
        soft_wrap=True,
    )


def _draw_sheets(source: Path | None, folder: Path, seed: int, *, json: bool) -> None:
    from node.dataset.sheets import draw_sheets

    for path in draw_sheets(source, folder, seed):
        if json:
            emit({"type": "sheet", "file": str(path)})
        else:
            typer.echo(path)
