"""What adaptive effort saves on successive frames, and what it costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from drivers.frame import Frame
from models.degrade.draw import DrawKey
from models.estimate.adaptive import AdaptiveCamera
from models.estimate.camera import CameraEstimator
from models.estimate.filter import level_filter
from models.estimate.level import LEVELS, Estimate
from models.evaluate.camera import degrade
from models.evaluate.camera_clip import CLIPS, clip_frames, scheduled
from models.evaluate.report import Table

Image = NDArray[np.uint8]
Look = Callable[[Image, int], Estimate | None]


def effort_table(estimator: CameraEstimator, data: Path, every: int) -> Table:
    """Return time a frame and filtered error with all frames looked at whole, and adaptively.

    Each of the real clips twice: as it is, and with the scheduled injection.
    """
    rows = []
    ways: dict[str, Callable[[], Look]] = {
        "whole look at every frame": estimator.follow,
        "adaptive": lambda: AdaptiveCamera(estimator).estimate,
    }
    clips = [clip_frames(data, clip, every=every) for clip in CLIPS]
    for name, injects in (("clean", False), ("scheduled injection", True)):
        for way, make_look in ways.items():
            figures = [_follow(make_look(), frames, injects) for frames in clips]
            time_us, looks, error = np.mean(figures, axis=0).tolist()
            rows.append((name, way, time_us, 100 * looks, error))
    columns = (
        "clips",
        "effort",
        "run time a frame, µs",
        "frames looked at, %",
        "mean error, points",
    )
    return Table("Camera: adaptive effort on three clips, after the filter", columns, tuple(rows))


def _follow(look: Look, frames: Sequence[Frame], injects: bool) -> tuple[float, float, float]:
    """Return mean run time, µs, share of the frames looked at, and mean error, points."""
    levels = level_filter("camera")
    truth = scheduled(len(frames)) if injects else [("clean", 0.0)] * len(frames)
    looks, errors, elapsed = 0, [], 0.0
    for frame, (kind, level) in zip(frames, truth, strict=True):
        key = DrawKey(0, frame.sensor, frame.sequence)
        _, image = degrade(kind, level, key, frame.image)
        start = perf_counter()
        estimate = look(image, frame.stamp_ns)
        elapsed += perf_counter() - start
        if estimate is None:
            filtered = levels.predict(frame.stamp_ns)
        else:
            looks += 1
            filtered = levels.update(frame.stamp_ns, estimate.probabilities)
        errors.append(abs(float(filtered @ LEVELS) - level))
    return elapsed / len(frames) * 1e6, looks / len(frames), float(np.mean(errors))
