"""What successive frames tell of the lens, in real frames that were taken one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from drivers.frame import Frame
from models.estimate.camera import CameraEstimator
from models.estimate.filter import level_filter
from models.estimate.lens import LOOK_EVERY_S
from models.estimate.level import LENS_KINDS, Estimate
from models.evaluate.camera import CleanFrame, clean_frames
from models.evaluate.camera_clip import CLIPS, Track, clip_frames, draw_alone_and_run, track
from models.evaluate.codecs import Image
from models.evaluate.report import Picture, Table
from models.evaluate.timing import median_us

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RATE_HZ = 30
"""Frames a second of the run whose mean run time is measured."""
_SCENES = {"camvid_0006R0": "val", "camvid_Seq05VD": "test", "udacity_p1": "test"}
"""Split of the scenes whose frames were taken one after the other."""
_EVERY_S = 0.5
_SCENE_RATE_HZ = 25.0
_LEVELS = (10.0, 30.0, 60.0, 100.0)
_QUICK_LEVELS = (60.0,)
_SETTLED_S = 3.0
_SHOWN = 60.0
_FIRST = 2000


def lens_table(estimator: CameraEstimator, data: Path, *, quick: bool = False) -> Table:
    """Return what is said of drops and dirt on the lens, from three seconds on, in real footage."""
    cases = [("clean", 0.0), *product(LENS_KINDS, _QUICK_LEVELS if quick else _LEVELS)]
    rows: list[tuple[str | float, ...]] = []
    for name, footage in _footage(data, quick=quick).items():
        for kind, level in cases:
            tracks = [_tracks(estimator, frames, kind, level) for frames in footage]
            rows.append((name, kind, level, *_row(tracks, kind, level)))
    columns = (
        "frames of",
        "kind",
        "true level, %",
        "frames",
        "mean level, %",
        "mean std, points",
        "mean error, points",
        "of the frames alone",
        "of the filtered level",
        "kind right, %",
        "taken for clean, %",
    )
    return Table("Camera: drops and dirt on the lens, in successive frames", columns, tuple(rows))


def _row(tracks: Sequence[tuple[Track, Track]], kind: str, level: float) -> tuple[float, ...]:
    alone, run = (
        [estimate.with_lens() for both in tracks for estimate in _settled(both[way])]
        for way in (0, 1)
    )
    levels = np.array([estimate.level for estimate in run])
    kinds = np.array([estimate.kind for estimate in run])
    published = [estimate for _, track in tracks for estimate in _filtered(track)]
    return (
        len(run),
        float(levels.mean()),
        float(np.mean([estimate.std for estimate in run])),
        float(np.mean(np.abs(levels - level))),
        float(np.mean([abs(estimate.level - level) for estimate in alone])),
        float(np.mean([abs(estimate.level - level) for estimate in published])),
        100 * float(np.mean(kinds == kind)),
        100 * float(np.mean(kinds == "clean")),
    )


def _settled(shown: Track) -> list[Estimate]:
    """Return the estimates from three seconds on."""
    return [
        estimate
        for estimate, time_s in zip(shown.estimates, shown.seconds, strict=True)
        if time_s >= _SETTLED_S
    ]


def _filtered(shown: Track) -> list[Estimate]:
    """Return the same with the frames' own levels filtered in time, as they are published."""
    levels = level_filter("camera")
    filtered = [
        replace(estimate, probabilities=levels.update(stamp_ns, estimate.probabilities))
        for estimate, stamp_ns in zip(shown.estimates, shown.stamps_ns, strict=True)
    ]
    return [estimate.with_lens() for estimate in _settled(replace(shown, estimates=filtered))]


@dataclass(frozen=True, slots=True)
class Cost:
    """Run time of one frame, µs: alone, in a run, and in a run with a look at the lens."""

    alone_us: float
    run_us: float
    look_us: float

    @classmethod
    def of(cls, estimator: CameraEstimator, image: Image, rounds: int) -> Self:
        """Measure it."""
        second_ns = 10**9
        _, first = estimator.estimate_next(None, image, 0)
        _, history = estimator.estimate_next(first, image, second_ns)

        def after(elapsed_s: float) -> float:
            stamp_ns = second_ns + round(elapsed_s * second_ns)
            return median_us(lambda: estimator.estimate_next(history, image, stamp_ns), rounds)

        alone_us = median_us(lambda: estimator.estimate(image), rounds)
        return cls(alone_us, after(1 / RATE_HZ), after(LOOK_EVERY_S))

    @property
    def mean_us(self) -> float:
        """Of the frames of a run of ``RATE_HZ``."""
        looks = 1 / (LOOK_EVERY_S * RATE_HZ)
        return self.run_us + looks * (self.look_us - self.run_us)

    def table(self) -> Table:
        """Return it as a table."""
        rows = (
            ("alone", self.alone_us),
            ("in a run", self.run_us),
            ("in a run, with a look at the lens", self.look_us),
            (f"mean of a run of {RATE_HZ} Hz", self.mean_us),
        )
        columns = ("frame of 1600×900", "run time, µs")
        return Table("Camera: what the frames before cost", columns, rows)


def lens_picture(estimator: CameraEstimator, data: Path) -> Picture:
    """Return the plot of the estimates of a clip from the moment when it begins, unfiltered."""
    frames = clip_frames(data, CLIPS[0])
    shown = {kind: _tracks(estimator, frames, kind, _SHOWN) for kind in LENS_KINDS}

    def draw(figure: Figure) -> None:
        axes = figure.subplots(1, len(shown), sharey=True)
        for axis, (kind, (alone, run)) in zip(axes, shown.items(), strict=True):
            draw_alone_and_run(axis, run.seconds, run.levels, _means(alone), _means(run))
            axis.set_title(kind, size=10)
            axis.set_xlabel("time since the first frame, s")
        axes[0].set_ylabel("estimated level, %")
        axes[0].legend(frameon=False, fontsize=8)

    return Picture(f"Camera: {_SHOWN:.0f} % on the lens in a real clip", draw)


def _means(shown: Track) -> NDArray[np.float64]:
    return np.array([estimate.with_lens().level for estimate in shown.estimates])


def _tracks(
    estimator: CameraEstimator, frames: Sequence[Frame], kind: str, level: float
) -> tuple[Track, Track]:
    """Return the track of frames alone, and in a run."""
    truth = [(kind, level)] * len(frames)
    return track(estimator, frames, truth, alone=True), track(estimator, frames, truth)


def _footage(data: Path, *, quick: bool) -> dict[str, list[list[Frame]]]:
    """Return frames that one camera took one after the other, several of each sort."""
    if quick:
        return {"a clip by day": [clip_frames(data, CLIPS[1], every=4)]}
    by_day, by_night = CLIPS[:2], CLIPS[2:]
    frames = {split: clean_frames(data, split) for split in ("val", "test")}
    scenes = [_scene(frames[split], name) for name, split in _SCENES.items()]
    return {
        "two clips by day": [clip_frames(data, clip, every=2) for clip in by_day],
        "a clip by night": [clip_frames(data, clip, every=2) for clip in by_night],
        "three scenes, two frames a second": scenes,
    }


def _scene(frames: Sequence[CleanFrame], scene: str) -> list[Frame]:
    """Return frames of a scene as a camera's of 25 Hz, of which others came in between."""
    found = [frame for frame in frames if frame.scene == scene and "still" not in frame.name]
    return [
        Frame(
            image=frame.read(),
            sensor="camera",
            sequence=_FIRST + round(number * _EVERY_S * _SCENE_RATE_HZ),
            stamp_ns=round(number * _EVERY_S * 1e9),
            stamp_source="file",
        )
        for number, frame in enumerate(found)
    ]
