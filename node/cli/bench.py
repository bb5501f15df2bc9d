"""``murk bench``: error against run time, and the goals, measured here and now."""

from __future__ import annotations

from dataclasses import asdict
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from node.cli.output import emit

BENCHES = {
    "bus": ("node.bench.bus", "node.bench.gateway"),
    "decode": ("node.bench.decode", "node.bench.run"),
    "degrade": ("models.evaluate.degrade",),
    "estimate": ("models.evaluate.estimate",),
    "stability": ("models.evaluate.stability",),
}
"""Modules of each benchmark; each has ``run(quick) -> Iterator[Point | Goal]``."""


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
    from models.evaluate.report import Point

    if name not in BENCHES:
        raise SceneError(f"bench {name}", "is no benchmark", f"expected {', '.join(BENCHES)}")
    modules = [import_module(module) for module in BENCHES[name]]
    results = []
    for result in chain.from_iterable(module.run(quick) for module in modules):
        results.append(result)
        if json:
            kind = "point" if isinstance(result, Point) else "goal"
            met = {} if isinstance(result, Point) else {"met": result.met}
            emit({"type": kind, **asdict(result), **met})
    if not json:
        from node.cli.bench_tables import print_results

        print_results(name, results)
    if not quick:
        from models.evaluate.write import write_report

        write_report(name, "\n".join(module.__doc__ or "" for module in modules), results, docs)
