"""``murk bench``: error against run time, and the goals, measured here and now."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import asdict
from importlib import import_module
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated

import typer

from node.cli.output import emit

if TYPE_CHECKING:
    from models.evaluate.report import Result

BENCHES = {
    "bus": (
        "node.bench.bus",
        "node.bench.gateway",
        "node.bench.latency",
        "node.bench.ros2",
        "node.bench.mcap",
        "node.bench.view",
        "node.bench.rig",
    ),
    "decode": ("node.bench.decode", "node.bench.run"),
    "degrade": ("models.evaluate.degrade", "models.evaluate.peers"),
    "estimate": ("models.evaluate.estimate", "models.evaluate.estimate_radar"),
    "stability": ("models.evaluate.stability",),
    "switch": ("node.bench.switch",),
}
"""Modules of each benchmark; each has ``run(quick) -> Iterator[Result]``."""


def bench(
    name: Annotated[str, typer.Argument(help=f"One of: {', '.join(BENCHES)}.")],
    quick: Annotated[
        bool, typer.Option("--quick", help="Few repetitions; writes nothing.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON object a point or goal.")] = False,
    docs: Annotated[Path, typer.Option(help="Where the report goes.", metavar="DIR")] = Path(
        "docs"
    ),
) -> None:
    """Measure a benchmark; without --quick also write docs/NAME.md with its plots."""
    from dbc.errors import SceneError

    if name not in BENCHES:
        raise SceneError(f"bench {name}", "is no benchmark", f"expected {', '.join(BENCHES)}")
    modules = list(_modules(name))
    results: list[Result] = []
    for result in chain.from_iterable(module.run(quick) for module in modules):
        results.append(result)
        if json:
            _emit(result)
    if not json:
        from node.cli.bench_tables import print_results

        print_results(name, results)
    if not quick:
        from models.evaluate.write import write_report

        write_report(name, "\n".join(module.__doc__ or "" for module in modules), results, docs)


def _modules(name: str) -> Iterator[ModuleType]:
    """Import a benchmark's modules; one whose extra is missing is said and left out."""
    from dbc.errors import MissingExtra

    for module in BENCHES[name]:
        try:
            yield import_module(module)
        except MissingExtra as missing:
            sys.stderr.write(f"murk: left out: {missing}\n")


def _emit(result: Result) -> None:
    """Write a result as a JSON line; a picture is for the page only."""
    from models.evaluate.report import Goal, Picture

    if isinstance(result, Picture):
        return
    met = {"met": result.met} if isinstance(result, Goal) else {}
    emit({"type": type(result).__name__.lower(), **asdict(result), **met})
