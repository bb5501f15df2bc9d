"""Camera: how near the estimates come to the truth, and what they cost.

Clean frames of the split `test`, degraded at native size (blur, over, under, noise in equal shares,
levels uniform over the eleven), where real data is found. The error is the mean distance of the
mean level from the true one. Opponents were trained and measured on the same frames by
`murk train camera --opponent NAME`; their run time is that of then, times what the shipped network
takes now over what it took beside them then.

Drops on the lens, and most of dirt, show in successive frames only, for they stand still while the
scene moves past: four times a second the lens is looked at. In the tables of kinds, whose frames
stand alone, drops are therefore taken for clean.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter_ns

import numpy as np

from models.estimate.adaptive import GLANCE
from models.estimate.camera import CameraEstimator
from models.estimate.filter import level_filter
from models.estimate.level import LEVELS
from models.estimate.network import WEIGHTS
from models.evaluate import camera_clip, tried
from models.evaluate.answer_plots import (
    confusion_picture,
    expected_calibration_error,
    reliability_picture,
)
from models.evaluate.camera import MAIN_KINDS, Answers, CleanFrame, clean_frames, measure
from models.evaluate.camera_effort import effort_table
from models.evaluate.camera_tables import (
    beyond_table,
    extremes_table,
    further_answers,
    groups_table,
    kinds_table,
    sizes_table,
)
from models.evaluate.camera_tunnel import tunnel_picture, tunnel_table
from models.evaluate.codecs import Image
from models.evaluate.filter_rates import filter_results
from models.evaluate.int8 import int8_copy
from models.evaluate.lens import RATE_HZ, Cost, lens_picture, lens_table
from models.evaluate.opponents import CAMERA_PAPER_ACCURACY, opponent_points, read_opponents
from models.evaluate.report import Goal, Point, Result, Table
from models.evaluate.restore import restoration_table
from models.evaluate.timing import camera_data, median_us, one_thread
from models.world.camera import WorldCamera
from models.world.road import World

UNIT = "points of level, camera"
EFFORTS = (1 / 16, 1 / 8, GLANCE, 1 / 2, 1.0, 2.0, 4.0)

_DRAWS = 8
_FEW = 30


def run(quick: bool) -> Iterator[Result]:
    """Measure the shipped network, its variants and its opponents."""
    with one_thread():
        estimator = CameraEstimator()
        image = next(WorldCamera(World(1, 1.0), width=1600, height=900).frames()).image
        rounds = 10 if quick else 200
        cost = Cost.of(estimator, image, rounds)
        run_time_us = cost.alone_us
        yield Goal("camera, 1600×900, one thread, ms", run_time_us / 1e3, 1.5, False)
        yield Goal(f"the same, mean of a run of {RATE_HZ} Hz, ms", cost.mean_us / 1e3, 1.5, False)
        yield cost.table()
        yield extremes_table(estimator)
        yield sizes_table(estimator, quick)
        yield tried.CAMERA
        data = camera_data()
        if data is None:
            return
        frames = clean_frames(data, "val" if quick else "test")
        few = frames[:: max(1, len(frames) // _FEW)]
        answers = measure(
            estimator.estimate, few if quick else frames, draws=2 if quick else _DRAWS
        )
        yield from _accuracy(answers, few if quick else frames)
        yield from _rivals(estimator, answers, run_time_us, few if quick else frames[::2], rounds)
        yield _opponents(answers)
        half = few[::3] if quick else frames[::2]
        further = further_answers(estimator, half)
        yield beyond_table(estimator, half, further)
        yield kinds_table(answers, further)
        yield restoration_table(estimator, few if quick else frames[::4])
        yield from _in_time(estimator, data, 8 if quick else 1)
        yield lens_table(estimator, data, quick=quick)
        yield lens_picture(estimator, data)


def _accuracy(answers: Answers, frames: Sequence[CleanFrame]) -> Iterator[Result]:
    table = answers.table()
    error = expected_calibration_error(answers.probabilities, answers.levels)
    yield Goal("camera, 11 levels right, %", 100 * table["all"]["accuracy"], 90.0)
    yield Goal("camera, mean error, points", table["all"]["mean_error"], 2.0, False)
    yield Goal("camera, over-exposure, mean error, points", table["over"]["mean_error"], 6.0, False)
    yield groups_table(answers, frames)
    yield confusion_picture("Camera: confusion of the eleven levels", answers.confusion())
    yield reliability_picture(
        f"Camera: reliability (expected calibration error {error:.1%})",
        answers.probabilities,
        answers.levels,
    )


def _rivals(
    estimator: CameraEstimator,
    answers: Answers,
    run_time_us: float,
    frames: Sequence[CleanFrame],
    rounds: int,
) -> Iterator[Point]:
    """Yield error against run time: the network at several efforts, and its opponents."""
    image = next(WorldCamera(World(1, 1.0), width=1600, height=900).frames()).image
    for effort in EFFORTS:
        estimate = partial(estimator.estimate, effort=effort)
        if effort == 1.0:
            error = answers.table()["all"]["mean_error"]
            yield Point("camera network", "effort 1", run_time_us, error, UNIT, shipped=True)
        else:
            error = measure(estimate, frames, draws=2).table()["all"]["mean_error"]
            time_us = median_us(partial(estimate, image), rounds)
            yield Point("camera network", f"effort {effort:g}", time_us, error, UNIT)
    yield from _int8(frames, image, rounds)
    yield from opponent_points("camera", run_time_us, UNIT)


def _int8(frames: Sequence[CleanFrame], image: Image, rounds: int) -> Iterator[Point]:
    """Yield the network with weights of 8 bit, where the library that makes it is installed."""
    with TemporaryDirectory() as folder:
        file = int8_copy(WEIGHTS / "camera.onnx", Path(folder))
        if file is None:
            return
        estimate = CameraEstimator(file).estimate
    error = measure(estimate, frames, draws=2).table()["all"]["mean_error"]
    time_us = median_us(partial(estimate, image), rounds)
    yield Point("camera network, INT8", "effort 1", time_us, error, UNIT)


def _opponents(answers: Answers) -> Table:
    """Return accuracy and error of the opponents beside the network's."""
    rows: list[tuple[str | float, ...]] = [
        (
            opponent.name,
            f"{opponent.what} (reads {opponent.inputs})",
            opponent.samples,
            *_errors(opponent.tables["test"]),
        )
        for opponent in read_opponents("camera")
    ]
    unknown = ("–",) * (1 + len(MAIN_KINDS))
    reported = ("paper, as it reports", "on data and splits of its own", "–")
    rows.append((*reported, 100 * CAMERA_PAPER_ACCURACY, *unknown))
    rows.append(("murk", "the shipped network", "see its card", *_errors(answers.table())))
    columns = ("network", "what it is", "samples", "level right, %", "mean error, points")
    title = "Camera: opponents, trained on the same frames"
    return Table(title, (*columns, *(f"of {kind}" for kind in MAIN_KINDS)), tuple(rows))


def _errors(table: dict[str, dict[str, float]]) -> tuple[float, ...]:
    kinds = [table[kind]["mean_error"] if kind in table else np.nan for kind in MAIN_KINDS]
    return (100 * table["all"]["accuracy"], table["all"]["mean_error"], *kinds)


def _in_time(estimator: CameraEstimator, data: Path, every: int) -> Iterator[Result]:
    """Yield a clip with a scheduled injection, the filter's rates, and adaptive effort."""
    frames = camera_clip.clip_frames(data, camera_clip.CLIPS[0], every=every)
    shown = camera_clip.track(estimator, frames, camera_clip.scheduled(len(frames)))
    yield camera_clip.clip_picture("Camera: a real clip with a scheduled injection", shown)
    yield tunnel_table(estimator, data)
    yield tunnel_picture(estimator, data)
    tracks = camera_clip.level_tracks(estimator, data, every=2 * every)
    yield camera_clip.step_picture("Camera: a step to 60 %, mean of three clips", tracks)
    answers = [track.answers for track in tracks]
    yield from filter_results("camera", answers, level_filter("camera"), _filter_us())
    yield effort_table(estimator, data, every)


def _filter_us() -> float:
    update, uniform = level_filter("camera").update, np.full(len(LEVELS), 1 / len(LEVELS))
    return median_us(lambda: update(perf_counter_ns(), uniform), 50)
