"""``murk set``: a parameter of a running node."""

from __future__ import annotations

from typing import Annotated

import typer


def set_parameter(
    node: Annotated[str, typer.Argument(metavar="NODE", help="Name of its scene.")],
    parameter: Annotated[
        str, typer.Argument(metavar="PARAMETER", help="'active', or SENSOR.KIND of an injection.")
    ],
    value: Annotated[float, typer.Argument(metavar="VALUE", help="1 or 0, or a level in %.")],
) -> None:
    """Change a parameter of a node that runs: 'murk set tunnel camera.noise 60'."""
    from node.control import set_level

    set_level(node, parameter, value, role="node")
