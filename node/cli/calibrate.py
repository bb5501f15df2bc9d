"""``murk calibrate``: a small correction of one sensor, from some minutes of clean driving."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from node.cli.output import emit, plain_console
from node.cli.train import Sensor


def calibrate(
    sensor: Annotated[Sensor, typer.Argument(help="What the sensor is.")],
    paths: Annotated[list[Path], typer.Argument(help="Its clean driving, as murk estimate reads.")],
    output: Annotated[
        Path | None,
        typer.Option(help="File to write [default: SENSOR-calibration.json].", metavar="FILE"),
    ] = None,
    seed: Annotated[int, typer.Option(help="Same drive and seed: same file.", min=0)] = 0,
    json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
) -> None:
    """Fit a small correction to a sensor's clean driving; a scene names it as 'calibration'."""
    from models.evaluate.calibrate import calibrate as fit_to
    from node.batch import parts, streams
    from node.estimator import load_follower

    found = (stream for path in paths for part in parts(path) for stream in streams(part))
    messages = chain.from_iterable(own for _, kind, own in found if kind == sensor)
    correction, worth = fit_to(sensor.value, messages, partial(load_follower, sensor.value), seed)
    file = output or Path(f"{sensor}-calibration.json")
    correction.write(file)
    if json:
        emit({"type": "calibration", "output": str(file), **asdict(correction), **asdict(worth)})
        return
    from rich.table import Table

    title = f"{worth.answers} frames or windows; the last third judges"
    table = Table("", "before", "after", title=title)
    for name, (before, after) in (
        ("mean error, points", worth.error),
        ("level where it is clean, %", worth.clean_level),
        ("surprise, nats", worth.surprise),
    ):
        table.add_row(name, f"{before:.2f}", f"{after:.2f}")
    console = plain_console()
    console.print(table)
    console.print(f"wrote {file}")
