"""``murk train``: train the network of a sensor, measure it, and write it with its card.

On drives without murk's index, the camera's shipped network is fine-tuned instead.
"""

from __future__ import annotations

from enum import StrEnum
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from node.cli.output import emit, plain_console


class Sensor(StrEnum):
    """A sensor whose network can be trained."""

    camera = "camera"
    radar = "radar"


def train(
    sensor: Annotated[Sensor, typer.Argument(help="Whose network.")],
    data: Annotated[
        Path,
        typer.Option(
            help="Folder of recordings; or of your own clean drives, to tune the camera's network.",
            envvar="MURK_DATA",
            metavar="DIR",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(help="ONNX file to write [default: SENSOR.onnx].", metavar="FILE"),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="A trial in seconds; not a network to use.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Same data and seed: same network.", min=0)] = 0,
    opponent: Annotated[
        str | None,
        typer.Option(
            help="Train what the network is compared with: regressor, trees, paper, width_64; "
            "another name lists all.",
            metavar="NAME",
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object a line.")] = False,
) -> None:
    """Train the network of a sensor; needs the extra 'train'."""
    console = plain_console()

    def report(progress: dict[str, object]) -> None:
        if json:
            emit({"type": "progress", **progress})
        else:
            console.print("  ".join(f"{name} {value}" for name, value in progress.items()))

    if opponent:
        training = import_module(f"models.training.{sensor}_opponents")
        output = output or Path(f"{sensor}_{opponent}.json")
        train_network = partial(training.train_opponent, opponent)
    else:
        training = import_module(f"models.training.{sensor}")
        output = output or Path(f"{sensor}.onnx")
        train_network = training.train
    summary = train_network(data, output, quick=quick, seed=seed, report=report)
    if json:
        emit({"type": "summary", **summary})
    else:
        card = "" if opponent else f" and its card {output.with_suffix('.md')}"
        console.print(f"wrote {output}{card}")
