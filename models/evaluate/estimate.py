"""Camera: how near the estimates come to the truth, and what they cost.

Clean frames of the split `test`, degraded at native size (blur, over, under, noise in equal shares,
levels uniform over the eleven), where real data is found. The error is the mean distance of the
mean level from the true one.
"""

from __future__ import annotations

from collections.abc import Iterator

from models.estimate.camera import CameraEstimator
from models.evaluate import camera
from models.evaluate.report import Goal, Point, Result
from models.evaluate.timing import camera_data, median_us, one_thread
from models.world.camera import WorldCamera
from models.world.road import World

UNIT = "points of level, camera"


def run(quick: bool) -> Iterator[Result]:
    """Measure the shipped network."""
    with one_thread():
        yield from _camera(quick)


def _camera(quick: bool) -> Iterator[Result]:
    estimator = CameraEstimator()
    image = next(WorldCamera(World(1, 1.0), width=1600, height=900).frames()).image
    run_time_us = median_us(lambda: estimator.estimate(image), 10 if quick else 100)
    yield Goal("camera, 1600×900, one thread, ms", run_time_us / 1e3, 1.5, False)
    data = camera_data()
    if data is None:
        return
    frames = camera.clean_frames(data, "val" if quick else "test")
    answers = camera.measure(estimator.estimate, frames[:: len(frames) // 30] if quick else frames)
    table = answers.table()
    for kind, row in table.items():
        yield Point("camera network", kind, run_time_us, row["mean_error"], UNIT)
    yield Goal("camera, 11 levels right, %", 100 * float(answers.hits.mean()), 90.0)
    yield Goal("camera, mean error, points", table["all"]["mean_error"], 2.0, False)
    yield Goal("camera, over-exposure, mean error, points", table["over"]["mean_error"], 6.0, False)
