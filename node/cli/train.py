"""``murk train``: train a network of murk's, measure it, and write it with its card.

On drives without murk's index, the camera's shipped network is fine-tuned instead.
"""

from __future__ import annotations

from enum import StrEnum
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from dbc.errors import InputError
from node.cli.output import emit, plain_console


class Trainable(StrEnum):
    """What has a network of its own."""

    camera = "camera"
    lens = "lens"
    radar = "radar"


def train(
    sensor: Annotated[Trainable, typer.Argument(help="Whose network.")],
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
        typer.Option(help="ONNX file to write [default: NAME.onnx].", metavar="FILE"),
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
    """Train the network of a sensor, or the one for a camera's lens; needs the extra 'train'."""
    console = plain_console()

    def report(progress: dict[str, object]) -> None:
        if json:
            emit({"type": "progress", **progress})
        else:
            console.print("  ".join(f"{name} {value}" for name, value in progress.items()))

    if opponent:
        if sensor is Trainable.lens:
            raise InputError(
                "--opponent", "given for the lens", "the camera or the radar have some"
            )
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
