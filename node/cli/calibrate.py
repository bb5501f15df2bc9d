"""``murk calibrate``: a small correction of one sensor, from some minutes of clean driving."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from enum import StrEnum
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dbc.errors import InputError, MurkError
from node.cli.output import emit, plain_console

if TYPE_CHECKING:
    from node.batch import Message


class Sensor(StrEnum):
    """A sensor that can be calibrated."""

    camera = "camera"
    radar = "radar"


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
    """Fit a small correction to a sensor's clean driving; a scene names it as 'calibration'.

    Nothing is written where the last third of the drive, which judges, is no better for it.
    """
    from models.evaluate.calibrate import calibrate as fit_to
    from node.batch import parts, streams
    from node.estimator import load_follower

    found = (stream for path in paths for part in parts(path) for stream in streams(part))
    messages = chain.from_iterable(
        _of_one(own, name) for name, kind, own in found if kind == sensor
    )
    correction, worth = fit_to(sensor.value, messages, partial(load_follower, sensor.value), seed)
    before, after = worth.surprise
    if after > before:
        what = f"the correction helps nothing: surprise {before:.3f} nats before, {after:.3f} after"
        raise MurkError(f"{what}, nothing written; give more driving, or do without")
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


def _of_one(messages: Iterator[Message], source: str) -> Iterator[Message]:
    """Yield a source's messages.

    Raises
    ------
    InputError
        If they are of several sensors: a correction is of one.
    """
    first: str | None = None
    for message in messages:
        first = first or message.sensor
        if message.sensor != first:
            both = f"holds {first} and {message.sensor}"
            raise InputError(source, both, "give the log of one radar, filtered by candump")
        yield message
