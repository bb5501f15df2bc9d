"""What an estimator says of one message, and what the node publishes of a sensor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

LEVELS = np.arange(0.0, 101.0, 10.0)
"""The eleven noise levels, %, shape (11,)."""

OUTER_KINDS = ("fog", "rain", "snow", "dirt", "motion")
"""Kinds that come about outside the camera: weather, dirt on the lens, motion."""
IMAGE_KINDS = (
    "clean",
    "blur",
    "over",
    "under",
    "noise",
    "low_light",
    "poisson",
    "salt_pepper",
    "jpeg",
    "dead",
    *OUTER_KINDS,
)
"""Kinds that one frame shows; of dirt only where much of it lies thick."""
FRAME_KINDS = (*IMAGE_KINDS, "tunnel")
"""Kinds that the camera's network tells apart, the last of them by what was before the frame."""
LENS_KINDS = ("drops", "dirt")
"""Kinds that stand still while the scene moves past."""
LENS_ODDS = 0.03
"""Odds of drops, and of dirt, at any level, against a clean lens on a drive."""
CAMERA_KINDS = (*FRAME_KINDS, "drops")
"""Kinds that a camera's estimate tells apart, the last by successive frames only."""
RADAR_KINDS = (
    "clean",
    "snr",
    "ghosts",
    "missed",
    "jitter",
    "noise_jam",
    "interference",
    "blockage",
)
"""Kinds that the radar's network tells apart; images, deception and a bent bracket are not."""

_MOST_LOG = 50.0


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A network's answer for one frame or scan, unfiltered.

    Attributes
    ----------
    probabilities:
        (11,) float64 over ``LEVELS``, sums to 1.
    kind_probabilities:
        Probability by kind, sums to 1.
    effort:
        Share of the usual reading that it took; see ``models.estimate.adaptive``.
    lens:
        What the frames of the last seconds say of the lens, where a camera's were looked at: log
        likelihoods (2, 10) of ``LENS_KINDS`` at the levels from 10 % on, against a clean lens. Not
        in the probabilities, since a filter in time would take it for news in every frame.
    """

    probabilities: NDArray[np.float64]
    kind_probabilities: dict[str, float]
    effort: float = 1.0
    lens: NDArray[np.float64] | None = None

    @property
    def level(self) -> float:
        """Mean of the distribution, %."""
        return float(self.probabilities @ LEVELS)

    @property
    def std(self) -> float:
        """Standard deviation of the distribution, %."""
        return float(np.sqrt(self.probabilities @ (LEVELS - self.level) ** 2))

    @property
    def kind(self) -> str:
        """The most probable kind."""
        return max(self.kind_probabilities, key=lambda kind: self.kind_probabilities[kind])

    def with_lens(self) -> Estimate:
        """Return the estimate once what is said of the lens has its share of the clean part.

        What shows of other kinds stays as it is: blur and noise hide what is on the lens.
        """
        if self.lens is None:
            return self
        prior = LENS_ODDS / self.lens.shape[1]
        odds = prior * np.exp(np.clip(self.lens, -_MOST_LOG, _MOST_LOG))
        kinds = dict(self.kind_probabilities)
        shared = min(kinds["clean"], float(self.probabilities[0]))
        left, taken = shared / (1 + odds.sum()), shared * odds / (1 + odds.sum())
        probabilities = self.probabilities.copy()
        probabilities[0] += left - shared
        probabilities[1:] += taken.sum(axis=0)
        kinds["clean"] += left - shared
        for kind, part in zip(LENS_KINDS, taken.sum(axis=1).tolist(), strict=True):
            kinds[kind] = kinds.get(kind, 0.0) + part
        return replace(self, probabilities=probabilities, kind_probabilities=kinds, lens=None)


@dataclass(frozen=True, slots=True, eq=False)
class NoiseLevel:
    """The published noise level of one sensor at one message.

    Attributes
    ----------
    sensor:
        The sensor's name in the scene.
    stamp_ns:
        Moment of capture of the message, integer nanoseconds.
    level, std:
        Filtered level and its standard deviation, %.
    probabilities:
        (11,) float64 over ``LEVELS``, filtered.
    kind, kind_probabilities:
        Most probable kind, and the probability of each.
    raw:
        Level as the network says it, before the filter in time, %.
    injected:
        ``{kind: level in %}`` that was injected into this message; None where nothing was.
    latency_ns:
        From the message's arrival at the node until it was published, nanoseconds.
    sequence:
        The message's own.
    dropped:
        Messages of this sensor lost before this one since the start: by the source and the queue.
    effort:
        Share of the usual reading that it took: 1, less for a glance, 0 where the level was only
        carried on in time.
    drawn:
        Of these the drawn parameters by kind, in the order in which they were applied: applied to
        the same message they give the same one again. Without those that the source did not tell.
    """

    sensor: str
    stamp_ns: int
    level: float
    std: float
    probabilities: NDArray[np.float64]
    kind: str
    kind_probabilities: dict[str, float]
    raw: float
    injected: dict[str, float] | None
    latency_ns: int
    sequence: int
    dropped: int
    effort: float = 1.0
    drawn: Mapping[str, Any] | None = None

    @property
    def true_level(self) -> float:
        """The injected level, %: the strongest kind's where several were, 0 where none was."""
        return max(self.injected.values(), default=0.0) if self.injected else 0.0
