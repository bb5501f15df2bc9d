"""What a filter's rates cost and give: steadiness at rest, reaction to a step, lag on a ramp."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from models.estimate.filter import LevelFilter
from models.estimate.level import LEVELS
from models.evaluate.report import Picture, Point, Result, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]

STEP = 60.0
"""Level of the steps, %."""
RATES_PER_S = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
CORRELATIONS_S = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0)
SHARED = (0.0, 0.3, 0.5, 0.7, 0.8, 0.9)
MEASURES = ("at rest", "in the second after a step", "on a ramp")

_SETTLED_S = 1.0
_LEAST = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class LevelTrack:
    """Unfiltered answers to successive frames or scans of one sensor, n in all.

    Attributes
    ----------
    stamps_ns:
        (n,) moments of capture, integer nanoseconds.
    levels:
        (n,) the true ones, %.
    probabilities:
        (n, 11) over ``LEVELS``.
    """

    stamps_ns: NDArray[np.int64]
    levels: FloatArray
    probabilities: FloatArray

    def filtered(self, levels: LevelFilter) -> FloatArray:
        """Return the probabilities after a new filter in time, (n, 11)."""
        return np.array(
            [
                levels.update(int(stamp_ns), answer)
                for stamp_ns, answer in zip(self.stamps_ns, self.probabilities, strict=True)
            ]
        )


def truths(count: int) -> list[FloatArray]:
    """Return the true levels, %, (count,), of a step up, a step down, and a ramp over all."""
    up = np.where(np.arange(count) < count // 2, 0.0, STEP)
    return [up, up[::-1].copy(), np.linspace(0.0, 100.0, count)]


def errors(tracks: Sequence[LevelTrack], make_filter: Callable[[], LevelFilter]) -> FloatArray:
    """Return the mean error of the filtered level by ``MEASURES``, (3,), points of level.

    At rest is where the true level has not changed for a second, be it 0 or not; a track whose
    level changes more than twice is a ramp. NaN for what no track has.
    """
    found: list[list[FloatArray]] = [[], [], []]
    for track in tracks:
        error = np.abs(track.filtered(make_filter()) @ LEVELS - track.levels)
        seconds = (track.stamps_ns - track.stamps_ns[0]) * 1e-9
        changes = seconds[1:][np.diff(track.levels) != 0]
        if len(changes) > 2:
            found[2].append(error)
            continue
        moments = np.concatenate([[-np.inf], changes])
        after = seconds - moments[np.searchsorted(changes, seconds, "right")] < _SETTLED_S
        found[0].append(error[~after])
        found[1].append(error[after])
    pooled = [np.concatenate([np.empty(0), *own]) for own in found]
    return np.array([own.mean() if own.size else np.nan for own in pooled])


def honesty(
    tracks: Sequence[LevelTrack], make_filter: Callable[[], LevelFilter]
) -> tuple[float, float, float]:
    """Return whether filtered levels know how sure they are.

    Returns
    -------
    Mean standard deviation, points of level; share of true levels further than two of them (and
    one point, for the levels are eleven) from the mean, 0 to 1; mean −log probability of the level
    nearest to the true one, nats.
    """
    deviations, far, surprise = [], [], []
    for track in tracks:
        probabilities = track.filtered(make_filter())
        mean = probabilities @ LEVELS
        deviation = np.sqrt(np.maximum(probabilities @ LEVELS**2 - mean**2, 0.0))
        nearest = np.abs(track.levels[:, np.newaxis] - LEVELS).argmin(axis=1)
        of_truth = probabilities[np.arange(len(nearest)), nearest]
        deviations.append(deviation)
        far.append(np.abs(mean - track.levels) > 2 * deviation + 1)
        surprise.append(-np.log(np.maximum(of_truth, _LEAST)))
    means = (np.concatenate(own).mean() for own in (deviations, far, surprise))
    deviation, share, nats = map(float, means)
    return deviation, share, nats


def filter_results(
    sensor_type: str, tracks: Sequence[LevelTrack], shipped: LevelFilter, update_us: float
) -> Iterator[Result]:
    """Yield errors over each of a filter's two rates, the other as shipped: points and a plot.

    Then a table of what it costs, and gives, to take successive errors for alike.

    Parameters
    ----------
    sensor_type:
        ``camera`` or ``radar``, for the titles.
    update_us:
        Run time of one update, microseconds; no rate changes it.
    """
    curves = {}
    for name in ("drift", "jump"):
        default = getattr(shipped, f"{name}_per_s")
        rates = sorted({*RATES_PER_S, default})
        curves[name] = (rates, np.array([_errors_at(tracks, shipped, name, at) for at in rates]))
        for rate, found in zip(*curves[name], strict=True):
            knob = f"{name}={rate:g}/s" + (" (default)" if rate == default else "")
            for measure, error in zip(MEASURES, found, strict=True):
                variant, unit = f"{sensor_type}'s filter, {measure}", "points of level"
                yield Point(
                    variant, knob, update_us, float(error), f"{unit}, {sensor_type}'s filter"
                )
    name = sensor_type.capitalize()
    yield _picture(f"{name}: error over the filter's rates", curves, shipped)
    yield _alike_table(f"{name}: how far successive errors are alike", tracks, shipped)


def _alike_table(title: str, tracks: Sequence[LevelTrack], shipped: LevelFilter) -> Table:
    name, values, unit = "correlation_s", CORRELATIONS_S, " s"
    if shipped.shared:
        name, values, unit = "shared", SHARED, ""
    default = _parameters(shipped)[name]
    rows: list[tuple[str | float, ...]] = []
    for value in sorted({*values, default}):
        make_filter = partial(LevelFilter, **(_parameters(shipped) | {name: value}))
        deviation, share, nats = honesty(tracks, make_filter)
        knob = f"{value:g}{unit}" + (" (default)" if value == default else "")
        found = errors(tracks, make_filter).tolist()
        rows.append((knob, *found, deviation, 100 * share, nats))
    measures = (f"error {measure}, points" for measure in MEASURES)
    sure = ("mean std, points", "beyond two std and a point, %", "surprise, nats")
    return Table(title, (name.removesuffix("_s"), *measures, *sure), tuple(rows))


def _errors_at(
    tracks: Sequence[LevelTrack], shipped: LevelFilter, name: str, rate: float
) -> FloatArray:
    rates = _parameters(shipped) | {f"{name}_per_s": rate}
    return errors(tracks, lambda: LevelFilter(**rates))


def _parameters(levels: LevelFilter) -> dict[str, float]:
    """Return what a filter like this one is made from."""
    names = ("drift_per_s", "jump_per_s", "correlation_s", "shared")
    return {name: getattr(levels, name) for name in names}


def _picture(
    title: str, curves: dict[str, tuple[list[float], FloatArray]], shipped: LevelFilter
) -> Picture:
    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(curves), sharey=True)
        for axis, (name, (rates, found)) in zip(panels, curves.items(), strict=True):
            for measure, error in zip(MEASURES, found.T, strict=True):
                axis.plot(rates, error, marker="o", label=measure)
            axis.axvline(getattr(shipped, f"{name}_per_s"), color="0.6", linestyle=":")
            axis.set_xscale("log")
            axis.set_yscale("log")
            axis.yaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_minor_formatter("{x:g}")
            axis.set_xlabel(f"{name} rate, 1/s (dotted: default)")
            axis.spines[["top", "right"]].set_visible(False)
        panels[0].set_ylabel("mean error, points of level")
        panels[0].legend(frameon=False)

    return Picture(title, draw)
