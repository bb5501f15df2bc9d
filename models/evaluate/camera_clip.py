"""A real clip with a scheduled injection: true level against estimated, over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivers.frame import Frame
from drivers.video import open_video
from models.degrade.draw import DrawKey
from models.estimate.camera import CameraEstimator
from models.estimate.filter import LevelFilter, level_filter
from models.estimate.level import LEVELS, Estimate
from models.evaluate.camera import MAIN_KINDS, degrade
from models.evaluate.report import Picture, Point

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CLIPS = ("day_highway_960x540_25fps", "day_city_1242x374_10fps", "night_1920x1080_30fps")
DRIFTS_PER_S = (0.1, 0.3, 1.0, 3.0, 10.0)
STEP = 60.0

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

    def filtered(self, levels: LevelFilter) -> NDArray[np.float64]:
        """Return the probabilities after a filter in time, (n, 11)."""
        return np.array(
            [
                levels.update(stamp_ns, estimate.probabilities)
                for stamp_ns, estimate in zip(self.stamps_ns, self.estimates, strict=True)
            ]
        )


def clip_frames(data: Path, clip: str, *, every: int = 1) -> list[Frame]:
    """Return every so many frames of a clip of ``data/camera/clips``."""
    path = data / "camera" / "clips" / f"{clip}.mp4"
    with open_video(path, "camera") as source:
        return [frame for index, frame in enumerate(source) if index % every == 0]


def track(
    estimator: CameraEstimator, frames: Sequence[Frame], truth: Sequence[tuple[str, float]]
) -> Track:
    """Return what an estimator says of frames degraded frame by frame as ``truth`` says."""
    estimates = [
        estimator.estimate(
            degrade(kind, level, DrawKey(0, frame.sensor, frame.sequence), frame.image)[1]
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
        probabilities = shown.filtered(level_filter("camera"))
        level = probabilities @ LEVELS
        std = np.sqrt(np.maximum(probabilities @ LEVELS**2 - level**2, 0))
        axis, t = figure.subplots(), shown.seconds
        band = (np.clip(level - std, 0, 100), np.clip(level + std, 0, 100))
        axis.fill_between(t, *band, color=_COLOURS["estimate"], alpha=0.2, linewidth=0)
        axis.plot(t, shown.levels, color=_COLOURS["truth"], drawstyle="steps-post", label="true")
        axis.plot(t, level, color=_COLOURS["estimate"], label="estimated, ± 1 standard deviation")
        for time, kind, before in zip(t, shown.kinds, ["clean", *shown.kinds], strict=False):
            if kind not in ("clean", before):
                axis.text(time, 103, kind, color=_COLOURS["truth"], size=9)
        axis.set_xlabel("time, s")
        axis.set_ylabel("noise level, %")
        axis.set_ylim(-3, 112)
        axis.legend(loc="lower right", bbox_to_anchor=(1, 1), frameon=False, ncols=2)
        axis.spines[["top", "right"]].set_visible(False)

    return Picture(title, draw)


def steps(estimator: CameraEstimator, data: Path, *, every: int) -> list[Track]:
    """Return, for each clip and main kind, a track whose second half is degraded to 60 %."""
    tracks = []
    for clip in CLIPS:
        frames = clip_frames(data, clip, every=every)
        half = len(frames) // 2
        for kind in MAIN_KINDS:
            truth = [("clean", 0.0)] * half + [(kind, STEP)] * (len(frames) - half)
            tracks.append(track(estimator, frames, truth))
    return tracks


def filter_points(tracks: Sequence[Track], run_time_us: float, unit: str) -> Iterator[Point]:
    """Yield the error of the filtered level over the rate at which the filter lets it drift.

    Parameters
    ----------
    run_time_us:
        Of one update of the filter.
    """
    shipped = level_filter("camera")
    for drift in sorted({*DRIFTS_PER_S, shipped.drift_per_s}):
        rest, after = [], []
        for each in tracks:
            levels = LevelFilter(drift, shipped.jump_per_s, shipped.correlation_s)
            errors = np.abs(each.filtered(levels) @ LEVELS - each.levels)
            start_s = each.seconds[int(np.argmax(each.levels > 0))]
            rest.append(errors[each.levels == 0].mean())
            after.append(errors[(each.seconds >= start_s) & (each.seconds < start_s + 1)].mean())
        default = drift == shipped.drift_per_s
        knob = f"drift={drift:g}/s" + (" (default)" if default else "")
        for name, error in (("at rest", rest), ("in the second after a step", after)):
            yield Point(f"camera's filter, {name}", knob, run_time_us, float(np.mean(error)), unit)


def step_picture(title: str, tracks: Sequence[Track]) -> Picture:
    """Return the plot of the filtered level around the step, a line a kind, mean of the clips."""
    around = np.linspace(-0.5, 1.5, 81)

    def draw(figure: Figure) -> None:
        axis = figure.subplots()
        for kind in MAIN_KINDS:
            own = [each for each in tracks if each.kinds[-1] == kind]
            lines = []
            for each in own:
                level = each.filtered(level_filter("camera")) @ LEVELS
                start_s = each.seconds[int(np.argmax(each.levels > 0))]
                lines.append(np.interp(around, each.seconds - start_s, level))
            axis.plot(around, np.mean(lines, axis=0), label=kind)
        axis.plot([-0.5, 0, 0, 1.5], [0, 0, STEP, STEP], color="0.7", linestyle=":", label="true")
        axis.set_xlabel("time after the step, s")
        axis.set_ylabel("filtered level, %")
        axis.legend(frameon=False)
        axis.spines[["top", "right"]].set_visible(False)

    return Picture(title, draw)
