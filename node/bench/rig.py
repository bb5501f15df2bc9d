"""A whole rig on this computer: six cameras at 12 Hz and five radars at 14 Hz, in real time.

The rig is that of nuScenes. Each camera is a video file of 1600×900 pixels, each radar a candump
log, both recorded from the simulated world. A run time is CPU time a message, from file to
published level; an error is the messages that were dropped.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from drivers.candump import write_candump
from drivers.video_writer import VideoWriter
from models.evaluate.report import Goal, Point
from models.world.camera import WorldCamera
from models.world.radar import WorldRadar
from models.world.road import World
from node.bus.in_process import Bus
from node.pipeline import Pipeline
from node.plan import plan
from node.scene import check_scene

CAMERAS, CAMERA_HZ = 6, 12.0
RADARS = 5
CORES = 2
RECORDED_S = 4.0
RUN_S, QUICK_S = 30.0, 4.0


def run(quick: bool) -> Iterator[Point | Goal]:
    """Measure drops and CPU time a sensor of the whole rig on two cores."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(cores)[:CORES])
    try:
        summary = _run_rig(QUICK_S if quick else RUN_S)
    finally:
        os.sched_setaffinity(0, cores)
    sensors: dict[str, dict[str, Any]] = summary["sensors"]
    for kind in ("camera", "radar"):
        members = [counts for name, counts in sensors.items() if name.startswith(kind)]
        cpu_s = sum(one["cpu_s"] for one in members)
        estimated = sum(one["estimated"] for one in members)
        dropped = sum(one["dropped_by_queue"] + one["dropped_by_source"] for one in members)
        knob = f"{len(members)} × {members[0]['rate_hz']:.1f} Hz"
        yield Point(f"rig, a {kind}", knob, 1e6 * cpu_s / estimated, dropped, "messages dropped")
        share = 100 * cpu_s / len(members) / summary["wall_time_s"]
        yield Goal(f"rig, share of a core that a {kind} takes, %", share, 100 * CORES / 11, False)
    dropped = sum(one["dropped_by_queue"] + one["dropped_by_source"] for one in sensors.values())
    yield Goal(f"rig, messages dropped on {CORES} cores", dropped, 0, at_least=False)


def _run_rig(duration_s: float) -> dict[str, Any]:
    with TemporaryDirectory() as folder:
        clip, log = Path(folder) / "world.mp4", Path(folder) / "world.log"
        _record(clip, log)
        cameras = [
            {"name": f"camera_{number}", "type": "camera", "source": str(clip)}
            for number in range(CAMERAS)
        ]
        radars = [
            {"name": f"radar_{number}", "type": "radar", "source": str(log)}
            for number in range(RADARS)
        ]
        content = {
            "sensors": [*cameras, *radars],
            "clock": {"loop": True},
            "duration_s": duration_s,
        }
        with Bus() as bus:
            pipeline = Pipeline(plan(check_scene(content, "bench")), bus)
            for _ in pipeline.run():
                pass
            return pipeline.summary()


def _record(clip: Path, log: Path) -> None:
    world = World(seed=1, duration_s=RECORDED_S)
    write_candump(log, WorldRadar(world).frames())
    with VideoWriter(clip) as writer:
        for frame in WorldCamera(world, width=1600, height=900, rate_hz=CAMERA_HZ).frames():
            writer.write(frame.image, frame.stamp_ns)
