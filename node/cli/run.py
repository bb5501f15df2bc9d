"""``murk run``: sensors in, noise levels out."""

from __future__ import annotations

import signal
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from node.cli.output import emit
from node.cli.scene_flags import (
    CameraFlag,
    CanFlag,
    DurationFlag,
    FastFlag,
    HostFlag,
    InjectFlag,
    LoopFlag,
    PortFlag,
    RadarFlag,
    RecordFlag,
    Ros2Flag,
    SceneFile,
    SeedFlag,
    SpeedFlag,
    TokenFlag,
    ViewFlag,
    build_scene,
    output_flags,
)

if TYPE_CHECKING:
    from models.estimate.level import NoiseLevel
    from node.bus.in_process import Bus
    from node.events import ModelChoice, NodeEvent
    from node.health import SensorEvent
    from node.pipeline import Pipeline
    from node.scene import Scene

MOST_CHOICES = 100_000
"""A switch may make all its choices at the end of a run as fast as possible; none is dropped."""
JOIN_S = 2.0


def run(
    scene: SceneFile = None,
    radar: RadarFlag = None,
    camera: CameraFlag = None,
    inject: InjectFlag = None,
    speed: SpeedFlag = None,
    fast: FastFlag = False,
    loop: LoopFlag = False,
    duration: DurationFlag = None,
    seed: SeedFlag = None,
    picture: Annotated[
        Path | None, typer.Option(help="PNG file for levels over time.", metavar="FILE")
    ] = None,
    record: RecordFlag = None,
    ros2: Ros2Flag = False,
    can: CanFlag = None,
    view: ViewFlag = False,
    host: HostFlag = None,
    port: PortFlag = None,
    token: TokenFlag = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object a level.")] = False,
) -> None:
    """Estimate the noise levels of a scene's sensors; Ctrl-C ends with a summary."""
    execute(
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
            outputs=output_flags(
                picture=picture,
                record=record,
                ros2=ros2,
                can=can,
                view=view,
                host=host,
                port=port,
                token=token,
            ),
        ),
        json=json,
    )


def execute(scene: Scene, *, json: bool) -> dict[str, Any]:
    """Run a scene to its end, show its levels as they come, and return the summary.

    Raises
    ------
    MurkError
        If a source fails; the levels before that and the summary have been shown.
    """
    from dbc.errors import MurkError
    from node.bus.in_process import Bus
    from node.events import EVENT_TOPIC, MODEL_TOPIC
    from node.outputs import open_outputs
    from node.parameters import Parameters
    from node.pipeline import Pipeline
    from node.plan import plan

    kept: list[NoiseLevel] = []
    error: MurkError | None = None
    with Bus() as bus:
        listeners = []
        if json:
            listeners = [
                bus.subscribe(EVENT_TOPIC, _emit_node_event),
                bus.subscribe(MODEL_TOPIC, _emit_choice, depth=MOST_CHOICES),
                *(bus.subscribe(f"/murk/{one.name}/event", _emit_event) for one in scene.sensors),
            ]
        show = _emit_levels if json else _watch_levels
        with (
            closing(Pipeline(plan(scene), bus)) as pipeline,
            open_outputs(pipeline.plan, bus, pipeline.set_injection) as outputs,
            Parameters(pipeline, bus),
        ):
            _stop_on_signals(pipeline)
            try:
                show(pipeline, bus, kept if scene.outputs.picture else None)
            except MurkError as failed:
                error = failed
        for listener in listeners:
            listener.close()
            listener.join(JOIN_S)
    summary = pipeline.summary()
    if outputs:
        summary["outputs"] = {name: output.counts() for name, output in outputs.items()}
    if scene.outputs.picture and kept:
        from models.evaluate.picture import draw_levels

        draw_levels(kept, scene.outputs.picture)
        summary["picture"] = str(scene.outputs.picture)
    if json:
        emit({"type": "summary", **summary})
    elif error is None or any(counts["received"] for counts in summary["sensors"].values()):
        from node.cli.live import print_summary

        print_summary(summary)
    if error is not None:
        raise error
    return summary


def _stop_on_signals(pipeline: Pipeline) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: pipeline.stop())


def _emit_levels(pipeline: Pipeline, _: Bus, kept: list[NoiseLevel] | None) -> None:
    for level in pipeline.run():
        emit(as_record(level))
        if kept is not None:
            kept.append(level)


def _emit_event(event: SensorEvent) -> None:
    emit({"type": "event", **asdict(event)})


def _emit_node_event(event: NodeEvent) -> None:
    emit({"type": "node_event", **asdict(event)})


def _emit_choice(choice: ModelChoice) -> None:
    emit({"type": "model_choice", **asdict(choice)})


def _watch_levels(pipeline: Pipeline, bus: Bus, kept: list[NoiseLevel] | None) -> None:
    from node.cli.live import LiveView
    from node.events import MODEL_TOPIC

    with LiveView() as view:
        bus.subscribe(MODEL_TOPIC, view.choose)
        for level in pipeline.run():
            view.show(level)
            if kept is not None:
                kept.append(level)


def as_record(level: NoiseLevel) -> dict[str, Any]:
    """Return a noise level as the JSON object that ``murk run --json`` prints."""
    names = (
        "sensor",
        "stamp_ns",
        "level",
        "std",
        "probabilities",
        "kind",
        "kind_probabilities",
        "raw",
        "injected",
        "drawn",
        "latency_ns",
        "sequence",
        "dropped",
        "effort",
    )
    return {"type": "noise_level", **{name: getattr(level, name) for name in names}}
