"""How a camera's exposure moved in the seconds before a frame.

One frame does not tell a tunnel's mouth from a dark scene; what the camera saw shortly before does.
Of each frame only seven numbers are kept, as averages over several time constants τ that fade as
exp(−Δt/τ): any spacing of the frames, and two steps give what one of their sum gives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

MEASURES = 7
"""How many numbers say how a frame is exposed; see ``image_features.exposure``."""
TIME_CONSTANTS_S = (0.15, 0.6, 2.5, 10.0)
"""Of the averages, s: from a few frames to the drive along a tunnel."""
LONGEST_GAP_S = 2.0
"""Time without a frame after which what was seen before says nothing, s."""

_PERIOD_S = 0.04
_FINE = 10.0
_AT_FILLED = 2 + MEASURES
_AT_AWAY = _AT_FILLED + len(TIME_CONSTANTS_S)
_SEEN = _AT_AWAY + len(TIME_CONSTANTS_S) * MEASURES
_USUAL = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class ExposureHistory:
    """The exposure of one camera's successive frames, up to the newest.

    Attributes
    ----------
    began_ns, stamp_ns:
        Moments of capture of the first and of the newest frame, integer nanoseconds.
    averages:
        (4, 7) float64, the measures averaged over each of ``TIME_CONSTANTS_S``.
    """

    began_ns: int
    stamp_ns: int
    averages: NDArray[np.float64]

    @classmethod
    def begin(cls, stamp_ns: int, exposure: NDArray[np.float64]) -> Self:
        """Return the history of one frame."""
        return cls(stamp_ns, stamp_ns, np.tile(exposure, (len(TIME_CONSTANTS_S), 1)))

    def since_s(self, stamp_ns: int) -> float:
        """Return the time from the newest frame to another, s; below 0 where that came late."""
        return (stamp_ns - self.stamp_ns) * 1e-9

    def after(self, stamp_ns: int, exposure: NDArray[np.float64]) -> ExposureHistory:
        """Return the history once a frame is taken in.

        A frame that is not newer changes nothing. After ``LONGEST_GAP_S`` without a frame, or where
        the clock was set back by as much, a new history begins.

        Parameters
        ----------
        stamp_ns:
            Its moment of capture, integer nanoseconds.
        exposure:
            (7,) float64, its measures.
        """
        elapsed_s = self.since_s(stamp_ns)
        if abs(elapsed_s) > LONGEST_GAP_S:
            return ExposureHistory.begin(stamp_ns, exposure)
        if elapsed_s <= 0:
            return self
        weights = np.array(_filled(elapsed_s))[:, np.newaxis]
        averages = self.averages + weights * (exposure - self.averages)
        return ExposureHistory(self.began_ns, stamp_ns, averages)


def seen_before(
    history: ExposureHistory | None, stamp_ns: int, exposure: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return what a history says of the next frame: the network's second input.

    Whether there is a history, how long ago the newest frame of it was, how the frame is exposed,
    how far each average had time to fill, and how far the frame is from each, drawn apart near zero
    by asinh. Zeros where there is none: no frame before, none within ``LONGEST_GAP_S``, or this one
    is not newer.

    Returns
    -------
    (41,) float32.
    """
    seen = np.zeros(_SEEN, np.float32)
    if history is None or not 0 < (elapsed_s := history.since_s(stamp_ns)) <= LONGEST_GAP_S:
        return seen
    age_s = (history.stamp_ns - history.began_ns) * 1e-9
    seen[0] = 1
    seen[1] = math.log2(elapsed_s / _PERIOD_S) / _USUAL
    seen[2:_AT_FILLED] = exposure / _USUAL
    seen[_AT_FILLED:_AT_AWAY] = _filled(age_s)
    seen[_AT_AWAY:] = np.arcsinh(_FINE * (exposure - history.averages)).ravel()
    return seen


def _filled(elapsed_s: float) -> list[float]:
    """Return how far each of the averages fills in a time, 0 to 1."""
    return [-math.expm1(-elapsed_s / time_constant_s) for time_constant_s in TIME_CONSTANTS_S]


UNSEEN = seen_before(None, 0, np.zeros(MEASURES))
"""What says that there is no history."""
SEEN = UNSEEN.size
"""How many numbers ``seen_before`` returns."""
