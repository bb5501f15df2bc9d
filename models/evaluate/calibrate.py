"""Fits a sensor's small correction to its own clean driving, and says what it is worth.

A camera's frames are estimated as they are and degraded at known levels, by the main kinds. So are
a radar's scans, by their signal-to-noise ratio, a window of them at one level: the answer at its
end is what a run corrects. The correction is fitted to the first two thirds of the drive and judged
on the last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from models.degrade.draw import DrawKey
from models.degrade.kinds import module_of
from models.estimate.calibration import Calibration, fit
from models.estimate.level import LEVELS, Estimate
from models.estimate.radar_window import WINDOW

Look = Callable[[Any], Estimate]
"""Estimates successive messages of one sensor."""

MOST_ANSWERS = 400
"""Frames or windows beyond which the drive is thinned out, evenly."""

_LEAST_ANSWERS = 12
_KINDS = {"camera": ("blur", "over", "under", "noise"), "radar": ("snr",)}
_LENGTHS = {"camera": 1, "radar": WINDOW}
"""Messages on which one answer rests."""
_FITTED = 2 / 3


@dataclass(frozen=True, slots=True)
class Worth:
    """What a correction is worth on the part of the drive that it was not fitted to.

    Attributes
    ----------
    answers:
        Frames or windows of the whole drive, after thinning out.
    error, clean_level:
        Mean distance from the true level, and mean level of the clean messages; points, each
        before and after the correction.
    surprise:
        Mean −log probability of the true level, nats, before and after.
    """

    answers: int
    error: tuple[float, float]
    clean_level: tuple[float, float]
    surprise: tuple[float, float]


def calibrate(
    sensor: str, messages: Iterable[Any], new_look: Callable[[], Look], seed: int
) -> tuple[Calibration, Worth]:
    """Return the correction of a sensor, and its worth.

    Parameters
    ----------
    sensor:
        ``camera`` or ``radar``.
    messages:
        Frames or scans of clean driving, in order of time.
    new_look:
        Returns the network of that sensor as a run uses it, with nothing seen yet.
    seed:
        Of the degradations.

    Raises
    ------
    InputError
        If there are too few messages.
    """
    answers, levels = _answers(sensor, messages, new_look, seed)
    count, length = len(levels), _LENGTHS[sensor]
    if count < _LEAST_ANSWERS:
        expected = f"at least {_LEAST_ANSWERS * length} of this sensor"
        raise InputError("drive", "has too few messages", expected)
    first = round(_FITTED * count)
    correction = fit(sensor, list(chain(*answers[:first])), list(chain(*levels[:first])))
    last, truth = list(chain(*answers[first:])), np.array(levels[first:]).ravel()
    before, after = (_figures(each, truth) for each in (last, list(map(correction.apply, last))))
    error, clean_level, surprise = zip(before, after, strict=True)
    return correction, Worth(count, error, clean_level, surprise)


def _answers(
    sensor: str, messages: Iterable[Any], new_look: Callable[[], Look], seed: int
) -> tuple[list[list[Estimate]], list[list[float]]]:
    """Return estimates and true levels of every case of every frame or window."""
    answers: list[list[Estimate]] = []
    levels: list[list[float]] = []
    every = 1
    for index, window in enumerate(_windows(messages, _LENGTHS[sensor])):
        if index % every:
            continue
        cases = [(None, 0.0), *((kind, _level(seed, index, kind)) for kind in _KINDS[sensor])]
        levels.append([level for _, level in cases])
        answers.append([_last(sensor, window, case, new_look(), seed) for case in cases])
        if len(answers) == 2 * MOST_ANSWERS:
            answers, levels, every = answers[::2], levels[::2], 2 * every
    return answers, levels


def _windows(messages: Iterable[Any], length: int) -> Iterator[list[Any]]:
    """Yield messages by so many; what is left over at the end is left out."""
    rest = iter(messages)
    while len(window := list(islice(rest, length))) == length:
        yield window


def _last(
    sensor: str, window: list[Any], case: tuple[str | None, float], look: Look, seed: int
) -> Estimate:
    """Return the answer at the end of a window that is degraded at one level."""
    answers = [
        look(_degraded(sensor, message, *case, DrawKey(seed, sensor, message.sequence)))
        for message in window
    ]
    return answers[-1]


def _level(seed: int, index: int, kind: str) -> float:
    return float(DrawKey(seed, kind, index).generator("level").choice(LEVELS))


def _degraded(sensor: str, message: Any, kind: str | None, level: float, key: DrawKey) -> Any:
    if kind is None:
        return message
    module = module_of(sensor, kind)
    drawn = module.draw(kind, level, key)
    if sensor == "radar":
        return module.apply(drawn, message)
    return replace(message, image=module.apply(drawn, message.image))


def _figures(
    estimates: Sequence[Estimate], levels: NDArray[np.float64]
) -> tuple[float, float, float]:
    probabilities = np.array([estimate.probabilities for estimate in estimates])
    means = probabilities @ LEVELS
    right = probabilities[np.arange(len(levels)), np.searchsorted(LEVELS, levels)]
    return (
        float(np.abs(means - levels).mean()),
        float(means[levels == 0].mean()),
        float(-np.log(np.maximum(right, 1e-12)).mean()),
    )
