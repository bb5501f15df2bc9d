"""What a whole run costs: a radar scan, and a camera frame, from file to noise level.

Real recordings are used where ``MURK_DATA`` has them, the simulated world's otherwise.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

from models.evaluate.report import Goal, Point
from node.bus.in_process import Bus
from node.pipeline import Pipeline
from node.plan import plan
from node.scene import check_scene

RADAR_LOG = "radar/nuscenes_mini/scene-0061.log"
CLIP = "camera/clips/day_highway_960x540_25fps.mp4"


def run(quick: bool) -> Iterator[Point | Goal]:
    """Measure runs as fast as possible: CPU time a message, and times real time."""
    with TemporaryDirectory() as folder:
        radar, radar_name = _recording(RADAR_LOG) or _simulated_log(Path(folder))
        clip, clip_name = _recording(CLIP) or _simulated_clip(Path(folder))
        cpu_us, error, _ = _measure("radar", radar, quick)
        yield Point(f"run --fast, {radar_name}", "a scan", cpu_us, error, "% of noise level")
        yield Goal("CPU time a radar scan, file to noise level, ms", cpu_us / 1e3, 2.0, False)
        cpu_us, error, times = _measure("camera", clip, quick)
        yield Point(f"run --fast, {clip_name}", "a frame", cpu_us, error, "% of noise level")
        yield Goal("960×540 clip, times real time", times, 3.0)


def _recording(name: str) -> tuple[Path, str] | None:
    beside = Path(__file__).resolve().parents[3] / "shared" / "data"
    path = Path(os.environ.get("MURK_DATA") or beside) / name
    return (path, path.name) if path.is_file() else None


def _simulated_log(folder: Path) -> tuple[Path, str]:
    from drivers.candump import write_candump
    from models.world.radar import WorldRadar
    from models.world.road import World

    path = folder / "world.log"
    write_candump(path, WorldRadar(World(seed=1, duration_s=10.0)).frames())
    return path, "simulated world"


def _simulated_clip(folder: Path) -> tuple[Path, str]:
    from drivers.video_writer import VideoWriter
    from models.world.camera import WorldCamera
    from models.world.road import World

    path = folder / "world.mp4"
    with VideoWriter(path) as writer:
        for frame in WorldCamera(World(seed=1, duration_s=5.0)).frames():
            writer.write(frame.image, frame.stamp_ns)
    return path, "simulated world"


def _measure(sensor: str, source: Path, quick: bool) -> tuple[float, float, float]:
    """Return CPU time a message (µs), mean error of the level (%), and times real time."""
    best: tuple[float, float, float] | None = None
    for _ in range(1 if quick else 3):
        content = {
            "sensors": [{"name": sensor, "type": sensor, "source": str(source)}],
            "clock": {"fast": True},
        }
        with Bus() as bus:
            pipeline = Pipeline(plan(check_scene(content, "bench")), bus)
            cpu_s, wall_s = process_time(), perf_counter()
            levels = list(pipeline.run())
            cpu_s, wall_s = process_time() - cpu_s, perf_counter() - wall_s
        span_s = (levels[-1].stamp_ns - levels[0].stamp_ns) * 1e-9
        error = sum(abs(level.level - level.true_level) for level in levels) / len(levels)
        result = (cpu_s / len(levels) * 1e6, error, span_s / wall_s)
        best = min(best or result, result)
    assert best is not None
    return best
