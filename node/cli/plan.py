"""``murk plan``: which stages a scene keeps, which it leaves out, and why."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from node.cli.output import emit, plain_console
from node.cli.scene_flags import (
    CameraFlag,
    DurationFlag,
    FastFlag,
    InjectFlag,
    LoopFlag,
    RadarFlag,
    SceneFile,
    SeedFlag,
    SpeedFlag,
    build_scene,
)


def plan(
    scene: SceneFile = None,
    radar: RadarFlag = None,
    camera: CameraFlag = None,
    inject: InjectFlag = None,
    speed: SpeedFlag = None,
    fast: FastFlag = False,
    loop: LoopFlag = False,
    duration: DurationFlag = None,
    seed: SeedFlag = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object a stage.")] = False,
) -> None:
    """Show which stages a scene keeps, which it leaves out, and why."""
    from node.plan import plan as make_plan

    made = make_plan(
        build_scene(
            scene,
            radar=radar,
            camera=camera,
            inject=inject,
            speed=speed,
            fast=fast,
            loop=loop,
            duration=duration,
            seed=seed,
        )
    )
    if json:
        for stage in made.stages:
            emit({"type": "stage", **asdict(stage)})
        return
    from rich.table import Table
    from rich.text import Text

    table = Table("", "stage", "sensor", "reason", "loads")
    for stage in sorted(made.stages, key=lambda stage: not stage.kept):
        mark = Text("kept", "green") if stage.kept else Text("left out", "dim")
        loads = ", ".join(stage.libraries) if stage.kept else ""
        table.add_row(mark, stage.name, stage.sensor or "", stage.reason, loads)
    plain_console().print(table)
