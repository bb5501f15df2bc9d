"""A tunnel's mouth in real clips: what one frame tells of it, and what those before it add."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivers.frame import Frame
from models.estimate.camera import CameraEstimator
from models.estimate.level import Estimate
from models.evaluate.camera import TUNNEL_FRAMES, TUNNEL_PERIOD
from models.evaluate.camera_clip import CLIPS, Track, clip_frames, draw_alone_and_run, track
from models.evaluate.report import Picture, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LEVELS = (30.0, 60.0, 100.0)
_SHOWN = 60.0
_BEFORE = 40
"""Frames before the mouth."""
_PARTS = (0, 4, 8, 16, TUNNEL_FRAMES)
_INTO = {"into the light": 0, "into the dark": 1}


def tunnel_table(estimator: CameraEstimator, data: Path) -> Table:
    """Return what is said of a tunnel's transient, by time since the mouth, alone and in a run."""
    tracks = [
        _through(estimator, frames, into, level)
        for frames in [_around(clip_frames(data, clip)) for clip in CLIPS]
        for level, into in product(_LEVELS, _INTO.values())
    ]
    rows: list[tuple[str | float, ...]] = []
    for (first, after), way in product(pairwise(_PARTS), ("alone", "with those before")):
        part = slice(_BEFORE + first, _BEFORE + after)
        said = [
            (estimate, level)
            for alone, run in tracks
            for shown in [alone if way == "alone" else run]
            for estimate, level in zip(shown.estimates[part], shown.levels[part], strict=True)
        ]
        rows.append((f"{first} to {after - 1}", way, *_row(said)))
    columns = (
        "frames since the mouth",
        "frame",
        "frames",
        "mean error, points",
        "mean std, points",
        "kind right, %",
        "taken for over or under, %",
        "for clean, %",
    )
    return Table("Camera: a tunnel's mouth in three clips", columns, tuple(rows))


def _row(said: list[tuple[Estimate, float]]) -> tuple[float, ...]:
    kinds = [estimate.kind for estimate, _ in said]
    shares = [
        100 * np.isin(kinds, names).mean() for names in ("tunnel", ("over", "under"), "clean")
    ]
    errors = [abs(estimate.level - level) for estimate, level in said]
    stds = [estimate.std for estimate, _ in said]
    return (len(said), float(np.mean(errors)), float(np.mean(stds)), *map(float, shares))


def tunnel_picture(estimator: CameraEstimator, data: Path) -> Picture:
    """Return the plot of the estimates around a tunnel's mouth, alone and in a run, unfiltered."""
    frames = _around(clip_frames(data, CLIPS[0]))
    shown = {name: _through(estimator, frames, into, _SHOWN) for name, into in _INTO.items()}

    def draw(figure: Figure) -> None:
        axes = figure.subplots(1, len(shown), sharey=True)
        since = np.arange(len(frames)) - _BEFORE
        for axis, (name, (alone, run)) in zip(axes, shown.items(), strict=True):
            draw_alone_and_run(axis, since, run.levels, _means(alone), _means(run))
            axis.set_title(name, size=10)
            axis.set_xlabel("frames since the mouth")
        axes[0].set_ylabel("estimated level, %")
        axes[0].legend(frameon=False, fontsize=8)

    return Picture(f"Camera: a tunnel's mouth of {_SHOWN:.0f} % in a real clip", draw)


def _means(shown: Track) -> NDArray[np.float64]:
    return np.array([estimate.level for estimate in shown.estimates])


def _around(frames: Sequence[Frame]) -> list[Frame]:
    return list(frames[: _BEFORE + TUNNEL_FRAMES])


def _through(
    estimator: CameraEstimator, frames: Sequence[Frame], into: int, level: float
) -> tuple[Track, Track]:
    """Return the track of frames through a mouth, each frame alone, and in a run."""
    first = 2 * TUNNEL_PERIOD + into * TUNNEL_PERIOD - _BEFORE
    numbered = [replace(frame, sequence=first + n) for n, frame in enumerate(frames)]
    truth = [("tunnel", level if n >= _BEFORE else 0.0) for n in range(len(frames))]
    return track(estimator, numbered, truth, alone=True), track(estimator, numbered, truth)
