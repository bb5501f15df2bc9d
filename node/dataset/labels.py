"""The labels of a run: one row an image or scan, as JSON lines and as CSV."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

from dbc.errors import InputError
from node.dataset.job import STATE, Job
from node.dataset.plan import Plan

COLUMNS = ("file", "sensor", "sequence", "kind", "level", "seed", "drawn")
"""``drawn`` are the drawn parameters: in the CSV file a JSON object."""


def write_labels(plan: Plan) -> tuple[Path, Path]:
    """Put the labels of all jobs that are done together, in the order of the plan.

    Unfinished files are removed.

    Returns
    -------
    ``labels.csv`` and ``labels.jsonl`` of the output.

    Raises
    ------
    InputError
        If they cannot be written.
    """
    lines, table = plan.output / "labels.jsonl", plan.output / "labels.csv"
    unfinished = plan.output / STATE / "unfinished"
    try:
        shutil.rmtree(unfinished, ignore_errors=True)
        unfinished.mkdir()
        done = [job for job in plan.jobs if job.is_done()]
        _write_lines(done, unfinished / lines.name)
        _write_table(done, unfinished / table.name)
        for path in (table, lines):
            (unfinished / path.name).replace(path)
        unfinished.rmdir()
    except OSError as error:
        raise InputError(plan.output, str(error.strerror).lower(), "give it again") from None
    return table, lines


def _write_lines(jobs: list[Job], path: Path) -> None:
    with path.open("w", encoding="utf-8") as file:
        file.writelines(_rows(jobs))


def _write_table(jobs: list[Job], path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for row in _rows(jobs):
            label = json.loads(row)
            label["drawn"] = json.dumps(label["drawn"])
            writer.writerow([label[column] for column in COLUMNS])


def _rows(jobs: list[Job]) -> Iterator[str]:
    for job in jobs:
        with job.labels.open(encoding="utf-8") as file:
            next(file)  # of what they are
            yield from file
