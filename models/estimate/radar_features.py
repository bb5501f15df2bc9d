"""What one radar scan shows of its own noise.

Its number of clusters; the lower edge of the echoes RCS − 40 log10(range), which a loss of
signal-to-noise ratio lifts (radar equation); and how well the velocities agree with one ego motion.
"""

from __future__ import annotations

import math

import numpy as np

from models.estimate.radar_view import Floats, ScanView

_FRACTIONS = np.array([0, 0.01, 0.02, 0.04, 0.07, 0.11, 0.17, 0.25, 0.35, 0.5, 0.65, 0.8, 0.95, 1])
_ABOVE_FLOOR_DB = np.array([0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0])
_RESIDUALS = np.array([[0.13], [0.38], [0.63], [2.0]])
"""Limits of the velocity residuals, m/s: the first three between the steps of the grid."""

FEATURES = 2 + len(_FRACTIONS) + len(_ABOVE_FLOOR_DB) + 3 * len(_RESIDUALS) + 2
"""Number of features."""


def features(view: ScanView) -> Floats:
    """Return the features of a scan, (FEATURES,).

    Their number; the lower edge of the echoes and how many lie close above the sensor's detection
    floor; and how well the velocities agree with one ego motion.
    """
    n = len(view)
    echo = np.sort(view.echo_db)
    groups = [
        np.array([n / 125, math.log(n)]),
        _quantiles(echo, _FRACTIONS) / 15,
        echo.searchsorted(_ABOVE_FLOOR_DB) / 30,
        _doppler(view),
    ]
    return np.concatenate(groups)


def _quantiles(ordered: Floats, fractions: Floats) -> Floats:
    """Return linearly interpolated quantiles of sorted values (at a fifth of NumPy's time)."""
    return np.interp(fractions * (len(ordered) - 1), np.arange(len(ordered)), ordered)


def _doppler(view: ScanView) -> Floats:
    """Return how many velocities disagree with one ego motion, and that motion's magnitude.

    Jitter shows in the share of the stationary points that leave their step of the grid; ghosts,
    whose velocity lies on the line of sight, in the number of points that move sideways.
    """
    motion, still = view.motion, view.still
    residual = np.abs(view.velocity - motion.velocity(view.position))
    over = np.greater(residual[:, np.newaxis], _RESIDUALS).astype(np.float64)
    of_still = over @ still.astype(np.float64) / max(1, np.count_nonzero(still))
    sideways = over[1].sum(axis=1) / 4
    speed = math.tanh(math.hypot(motion.ahead, motion.left) / 5)
    return np.concatenate([of_still.ravel(), sideways, [speed, math.tanh(abs(motion.turn) * 10)]])
