"""A real clip with a scheduled injection: true level against estimated, over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivers.frame import Frame
from drivers.video import open_video
from models.degrade.draw import DrawKey
from models.estimate.camera import CameraEstimator
from models.estimate.filter import level_filter
from models.estimate.level import LEVELS, Estimate
from models.evaluate.camera import MAIN_KINDS, degrade
from models.evaluate.filter_rates import STEP, LevelTrack, truths
from models.evaluate.report import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Numbers = NDArray[np.float64] | NDArray[np.intp]

CLIPS = ("day_highway_960x540_25fps", "day_city_1242x374_10fps", "night_1920x1080_30fps")

_COLOURS = {"truth": "#c2410c", "estimate": "#0b6e99"}
_SCHEDULE = (("blur", 50.0), ("under", 70.0), ("noise", 40.0), ("over", 60.0))
"""Kinds and levels injected in turn, each for a ninth of the clip, with as long a rest between."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Estimates of successive frames of a clip.

    Attributes
    ----------
    stamps_ns:
        Moments of capture, integer nanoseconds.
    kinds, levels:
        The truth: kind and level in %.
    estimates:
        Unfiltered.
    """

    stamps_ns: list[int]
    kinds: list[str]
    levels: NDArray[np.float64]
    estimates: list[Estimate]

    @property
    def seconds(self) -> NDArray[np.float64]:
        """Time since the first frame, s."""
        return (np.array(self.stamps_ns) - self.stamps_ns[0]) * 1e-9

    @property
    def answers(self) -> LevelTrack:
        """The levels alone, as a filter in time takes them."""
        probabilities = np.array([estimate.probabilities for estimate in self.estimates])
        return LevelTrack(np.array(self.stamps_ns), self.levels, probabilities)


def clip_frames(data: Path, clip: str, *, every: int = 1) -> list[Frame]:
    """Return every so many frames of a clip of ``data/camera/clips``."""
    path = data / "camera" / "clips" / f"{clip}.mp4"
    with open_video(path, "camera") as source:
        return [frame for index, frame in enumerate(source) if index % every == 0]


def track(
    estimator: CameraEstimator,
    frames: Sequence[Frame],
    truth: Sequence[tuple[str, float]],
    *,
    alone: bool = False,
) -> Track:
    """Return what is said of frames that are degraded one by one as ``truth`` says.

    In a run, each with the history of those before it, or each ``alone``.
    """
    look = (lambda image, _: estimator.estimate(image)) if alone else estimator.follow()
    estimates = [
        look(
            degrade(kind, level, DrawKey(0, frame.sensor, frame.sequence), frame.image)[1],
            frame.stamp_ns,
        )
        for frame, (kind, level) in zip(frames, truth, strict=True)
    ]
    return Track(
        stamps_ns=[frame.stamp_ns for frame in frames],
        kinds=[kind if level else "clean" for kind, level in truth],
        levels=np.array([level for _, level in truth]),
        estimates=estimates,
    )


def scheduled(count: int) -> list[tuple[str, float]]:
    """Return kind and level of each of so many frames: ``_SCHEDULE`` with rests between."""
    turns = 2 * len(_SCHEDULE) + 1
    truth = []
    for index in range(count):
        turn, injects = divmod(index * turns // count, 2)
        truth.append(_SCHEDULE[turn] if injects else ("clean", 0.0))
    return truth


def clip_picture(title: str, shown: Track) -> Picture:
    """Return the plot of the true level against the filtered one with its standard deviation."""

    def draw(figure: Figure) -> None:
        probabilities = shown.answers.filtered(level_filter("camera"))
        level = probabilities @ LEVELS
        std = np.sqrt(np.maximum(probabilities @ LEVELS**2 - level**2, 0))
        axis, t = figure.subplots(), shown.seconds
        band = (np.clip(level - std, 0, 100), np.clip(level + std, 0, 100))
        blue, red = _COLOURS["estimate"], _COLOURS["truth"]
        axis.fill_between(t, *band, step="post", color=blue, alpha=0.2, linewidth=0)
        axis.step(t, shown.levels, where="post", color=red, label="true")
        axis.step(t, level, where="post", color=blue, label="estimated, ± 1 standard deviation")
        for time, kind, before in zip(t, shown.kinds, ["clean", *shown.kinds], strict=False):
            if kind not in ("clean", before):
                axis.text(time, 103, kind, color=red, size=9)
        axis.set_xlabel("time, s")
        axis.set_ylabel("noise level, %")
        axis.set_ylim(-3, 112)
        axis.legend(loc="lower right", bbox_to_anchor=(1, 1), frameon=False, ncols=2)
        axis.spines[["top", "right"]].set_visible(False)

    return Picture(title, draw)


def level_tracks(estimator: CameraEstimator, data: Path, *, every: int) -> list[Track]:
    """Return, for each clip and main kind, a track of each of the ``truths``."""
    tracks = []
    for clip in CLIPS:
        frames = clip_frames(data, clip, every=every)
        for kind, levels in product(MAIN_KINDS, truths(len(frames))):
            tracks.append(track(estimator, frames, [(kind, float(level)) for level in levels]))
    return tracks


def step_picture(title: str, tracks: Sequence[Track]) -> Picture:
    """Return the plot of the filtered level around a step up, a line a kind, mean of the clips."""
    around = np.linspace(-0.5, 1.5, 81)

    def draw(figure: Figure) -> None:
        axis = figure.subplots()
        for kind in MAIN_KINDS:
            lines = []
            for each in tracks:
                if each.levels[0] != 0 or each.levels[-1] != STEP or each.kinds[-1] != kind:
                    continue
                level = each.answers.filtered(level_filter("camera")) @ LEVELS
                start_s = each.seconds[int(np.argmax(each.levels > 0))]
                lines.append(np.interp(around, each.seconds - start_s, level))
            axis.plot(around, np.mean(lines, axis=0), label=kind)
        axis.plot([-0.5, 0, 0, 1.5], [0, 0, STEP, STEP], color="0.7", linestyle=":", label="true")
        axis.set_xlabel("time after the step, s")
        axis.set_ylabel("filtered level, %")
        axis.legend(frameon=False)
        axis.spines[["top", "right"]].set_visible(False)

    return Picture(title, draw)


def draw_alone_and_run(
    axis: Axes, x: Numbers, truth: Numbers, alone: Numbers, run: Numbers
) -> None:
    """Plot true levels, and what is said of each frame alone and in a run, over time or frames."""
    axis.plot(x, truth, color=_COLOURS["truth"], drawstyle="steps-post", label="true")
    axis.plot(x, alone, color="0.6", label="each frame alone")
    axis.plot(x, run, color=_COLOURS["estimate"], label="with those before")
    axis.set_ylim(-3, 103)
    axis.spines[["top", "right"]].set_visible(False)
