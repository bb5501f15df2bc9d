"""Where the camera's network is right and where it is not, as tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from models.degrade.draw import DrawKey
from models.estimate.camera import CameraEstimator
from models.estimate.level import CAMERA_KINDS, LEVELS
from models.evaluate.camera import (
    COMBINED,
    MAIN_KINDS,
    Answers,
    CleanFrame,
    degrade,
    measure,
)
from models.evaluate.codecs import Image, gray, h264, jpeg, one_channel
from models.evaluate.report import Table
from models.evaluate.timing import median_us
from models.world.camera import WorldCamera
from models.world.road import World

FURTHER_KINDS = tuple(kind for kind in CAMERA_KINDS[1:] if kind not in MAIN_KINDS)

_COLUMNS = ("frames", "level right, %", "mean error, points", "mean std, points", "kind right, %")
_SIZES = ((640, 360), (960, 540), (1280, 720), (1600, 900), (1920, 1080))
_WORLD_SEEDS = range(2**31 + 200, 2**31 + 204)
_WORLD_FRAMES = (0, 100)

Row = tuple[str | int | float, ...]


def groups_table(answers: Answers, frames: Sequence[CleanFrame]) -> Table:
    """Return accuracy and error by true kind, time of day, weather and source."""
    rows = [_row("all", answers)]
    for index, kind in enumerate(CAMERA_KINDS):
        rows += _rows_of(kind, answers, answers.kinds == index)
    for name, values in (
        ("", [frame.condition for frame in frames]),
        ("weather ", [frame.weather for frame in frames]),
        ("camera ", [frame.source for frame in frames]),
    ):
        of_answers = np.array(values)[answers.frames]
        for value in sorted(set(values)):
            rows += _rows_of(f"{name}{value}", answers, of_answers == value)
    return Table(
        "Camera: error by kind, condition and camera", ("frames of", *_COLUMNS), tuple(rows)
    )


def further_answers(estimator: CameraEstimator, frames: Sequence[CleanFrame]) -> dict[str, Answers]:
    """Return what is answered to combinations of kinds and to the further kinds, by kind."""
    return {
        kind: measure(estimator.estimate, frames, draws=1, kinds=(kind,))
        for kind in (*COMBINED, *FURTHER_KINDS)
    }


def kinds_table(answers: Answers, further: Mapping[str, Answers]) -> Table:
    """Return for which kind each kind was taken, % of its frames."""
    counts = answers.kind_confusion()
    for kind in FURTHER_KINDS:
        counts += further[kind].kind_confusion()
    rows = [
        (kind, *(100 * row / row.sum()).tolist())
        for kind, row in zip(CAMERA_KINDS, counts, strict=True)
        if row.any()
    ]
    title = "Camera: for which kind each kind was taken, %"
    return Table(title, ("true kind", *CAMERA_KINDS), tuple(rows))


def beyond_table(
    estimator: CameraEstimator, frames: Sequence[CleanFrame], further: Mapping[str, Answers]
) -> Table:
    """Return accuracy and error of combined and further kinds, and after compression."""
    rows = [_row(kind, answers) for kind, answers in further.items()]
    compressions: dict[str, Callable[[Image], Image]] = {
        "main kinds, then JPEG 90": partial(jpeg, quality=90),
        "main kinds, then JPEG 75": partial(jpeg, quality=75),
        "main kinds, then H.264 crf 18": partial(h264, crf=18),
        "main kinds, then H.264 crf 23": partial(h264, crf=23),
    }
    for name, compression in compressions.items():
        answers = measure(estimator.estimate, frames, draws=1, afterwards=compression)
        rows.append(_row(name, answers))
    colourless = [_Colourless(frame) for frame in frames]
    answers = measure(estimator.estimate, colourless, draws=1, afterwards=one_channel)
    rows.append(_row("main kinds, camera without colour", answers))
    title = "Camera: combined and further kinds, compression after the degradation, no colour"
    return Table(title, ("degradation", *_COLUMNS), tuple(rows))


@dataclass(frozen=True, slots=True)
class _Colourless:
    """A clean frame as a camera without colour delivers it."""

    frame: CleanFrame

    @property
    def name(self) -> str:
        return self.frame.name

    def read(self) -> Image:
        return gray(self.frame.read())


def sizes_table(estimator: CameraEstimator, quick: bool) -> Table:
    """Return error and run time by size of frame, on the simulated world's camera."""
    rows: list[Row] = []
    for width, height in _SIZES[:2] if quick else _SIZES:
        errors = []
        for seed in _WORLD_SEEDS[:1] if quick else _WORLD_SEEDS:
            camera = WorldCamera(World(seed, 20.0), width=width, height=height)
            for sequence in _WORLD_FRAMES:
                image = camera.frame(sequence).image
                for kind in MAIN_KINDS:
                    for level in LEVELS[::2]:
                        key = DrawKey(seed, kind, sequence)
                        degraded = degrade(kind, float(level), key, image)[1]
                        errors.append(abs(estimator.estimate(degraded).level - level))
        run_time_us = median_us(partial(estimator.estimate, image), 5 if quick else 50)
        rows.append((f"{width}×{height}", len(errors), float(np.mean(errors)), run_time_us))
    title = "Camera: size of the frame (simulated drives, main kinds)"
    return Table(title, ("size", "frames", "mean error, points", "run time, µs"), tuple(rows))


def extremes() -> dict[str, Image]:
    """Return images that no camera should send, by name."""
    rng = np.random.default_rng(0)
    board = np.indices((480, 640)).sum(axis=0) % 2 * 255
    grey = np.clip(rng.normal(200, 1, (540, 960, 1)), 0, 255).repeat(3, axis=2)
    return {
        "black": np.zeros((540, 960, 3), np.uint8),
        "white": np.full((540, 960, 3), 255, np.uint8),
        "white wall": grey.astype(np.uint8),
        "checkerboard": board.astype(np.uint8)[..., np.newaxis].repeat(3, axis=2),
        "1×1 enlarged": np.full((720, 1280, 3), (10, 200, 90), np.uint8),
        "1×1": np.zeros((1, 1, 3), np.uint8),
        "pure noise": rng.integers(0, 256, (540, 960, 3), np.uint8),
        "one row": rng.integers(0, 256, (1, 60_000, 3), np.uint8),
        "tiny noise": rng.integers(0, 256, (3, 5, 3), np.uint8),
        "huge noise": rng.integers(0, 256, (4000, 6000, 3), np.uint8),
    }


def extremes_table(estimator: CameraEstimator) -> Table:
    """Return what is said of images that no camera should send."""
    rows = []
    for name, image in extremes().items():
        estimate = estimator.estimate(image)
        rows.append((name, estimate.level, estimate.std, estimate.kind))
    title = "Camera: images without a true level"
    return Table(title, ("image", "level, %", "standard deviation, points", "kind"), tuple(rows))


def _rows_of(name: str, answers: Answers, group: NDArray[np.bool_]) -> list[Row]:
    return [_row(name, answers.among(group))] if group.any() else []


def _row(name: str, answers: Answers) -> Row:
    table = answers.table()["all"]
    means = answers.probabilities @ LEVELS
    variances = answers.probabilities @ LEVELS**2 - means**2
    return (
        name,
        int(table["count"]),
        100 * table["accuracy"],
        table["mean_error"],
        float(np.sqrt(np.maximum(variances, 0)).mean()),
        100 * table["kind_accuracy"],
    )
