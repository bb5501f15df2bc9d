"""``murk demo``: twenty seconds of the simulated world, degraded on a schedule and estimated."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

SCENE: dict[str, Any] = {
    "name": "demo",
    "sensors": [
        {"name": "camera", "type": "camera", "source": "world"},
        {"name": "radar", "type": "radar", "source": "world"},
    ],
    "injections": [
        {"sensor": "camera", "kind": "blur", "points": [(2, 50), (5, 0)]},
        {
            "sensor": "camera",
            "kind": "over",
            "shape": "ramp",
            "points": [(6, 0), (7.5, 80), (9, 0)],
        },
        {"sensor": "camera", "kind": "under", "points": [(10, 70), (13, 0)]},
        {
            "sensor": "camera",
            "kind": "noise",
            "shape": "ramp",
            "points": [(14, 0), (16, 60), (18, 60), (18.1, 0)],
        },
        {"sensor": "radar", "kind": "snr", "points": [(6, 100), (13, 0)]},
    ],
}
"""Every camera kind in turn, and a drop of the radar's SNR by 10 dB."""


def demo(
    picture: Annotated[
        Path, typer.Option(help="PNG file for injected and estimated levels.", metavar="FILE")
    ] = Path("out/demo.png"),
    fast: Annotated[bool, typer.Option("--fast", help="As fast as possible.")] = False,
    duration: Annotated[float, typer.Option(help="Simulated seconds.", metavar="S")] = 20.0,
    seed: Annotated[int, typer.Option(help="Seed of the world and the injections.")] = 1,
    json: Annotated[bool, typer.Option("--json", help="One JSON object a level.")] = False,
) -> None:
    """Show murk at work on its simulated world, degraded on a schedule."""
    from node.cli.run import execute
    from node.scene import check_scene

    content = SCENE | {
        "seed": seed,
        "duration_s": duration,
        "clock": {"fast": fast},
        "outputs": {"picture": picture},
    }
    execute(check_scene(content, "demo"), json=json)
