"""The labels of a run: one row an image or scan, as JSON lines and as CSV."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

from node.dataset.job import STATE, Job
from node.dataset.plan import Plan

COLUMNS = ("file", "sensor", "sequence", "kind", "level", "seed", "drawn")
"""``drawn`` are the drawn parameters: in the CSV file a JSON object."""


def write_labels(plan: Plan) -> tuple[Path, Path]:
    """Put the labels of all jobs together, in the order of the plan; remove unfinished files.

    Returns
    -------
    ``labels.csv`` and ``labels.jsonl`` of the output.
    """
    lines, table = plan.output / "labels.jsonl", plan.output / "labels.csv"
    unfinished = plan.output / STATE / "unfinished"
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir()
    with (unfinished / lines.name).open("w", encoding="utf-8") as file:
        file.writelines(_rows(plan.jobs))
    with (unfinished / table.name).open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for row in _rows(plan.jobs):
            label = json.loads(row)
            label["drawn"] = json.dumps(label["drawn"])
            writer.writerow([label[column] for column in COLUMNS])
    for path in (table, lines):
        (unfinished / path.name).replace(path)
    unfinished.rmdir()
    return table, lines


def _rows(jobs: list[Job]) -> Iterator[str]:
    for job in jobs:
        with job.labels.open(encoding="utf-8") as file:
            yield from file
