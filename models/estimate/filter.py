"""The noise level in time: an exact filter in continuous time over the eleven levels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dbc.errors import InputError
from models.estimate.level import LEVELS

FloatArray = NDArray[np.float64]

SHARED_S = 1.0
"""Time between measurements up to which they may share data, s."""

_N = len(LEVELS)
_SERIES_LIMIT = 30.0
"""Drift steps up to which the positive series is used; beyond it every entry is above 1 %."""
_TERMS = 160
"""Terms of that series: the first one left out is below 1e-25 at the limit."""
_LEAST = 1e-6
"""Probability below which a measurement with correlated errors is taken for this one."""
_STATIONARY = 1e6
"""Drift steps after which the level is uniform to the last bit."""


def _walk_powers() -> FloatArray:
    """Return the powers 0 … ``_TERMS`` − 1 of the reflecting ±1 random walk, (terms, n · n)."""
    walk = np.diag(np.full(_N - 1, 0.5), 1) + np.diag(np.full(_N - 1, 0.5), -1)
    walk[0, 0] = walk[-1, -1] = 0.5
    powers = [np.eye(_N)]
    for _ in range(_TERMS - 1):
        powers.append(powers[-1] @ walk)
    return np.reshape(powers, (_TERMS, _N * _N))


_POWERS = _walk_powers()
_ORDER = np.arange(_TERMS)
_LOG_FACTORIAL = np.array([math.lgamma(k + 1.0) for k in range(_TERMS)])
_EIGENVALUES = 2.0 * np.cos(np.pi * np.arange(_N) / _N) - 2.0
_COSINES = np.cos(np.pi * np.outer(np.arange(_N) + 0.5, np.arange(_N)) / _N)
_EIGENVECTORS = _COSINES / np.linalg.norm(_COSINES, axis=0)


def transition(drift: float, jump: float) -> FloatArray:
    """Return the exact transition probabilities of the level over an interval.

    The generator is that of a birth–death chain with reflecting ends plus jumps to a level drawn
    uniformly from all; the two parts commute, so exp(Q·Δt) = e^(−jump) · D + (1 − e^(−jump)) / n.
    D is the Poisson mixture of powers of the random walk (uniformisation, Jensen 1953), whose
    terms are all positive: no entry, however small, loses digits. Over many steps D comes from
    the chain's eigenvectors, the DCT-II basis, which takes any number of steps.

    Parameters
    ----------
    drift:
        Birth rate (= death rate) times the interval, ≥ 0: expected moves to one neighbour.
    jump:
        Jump rate times the interval, ≥ 0.

    Returns
    -------
    (11, 11) float64, symmetric, non-negative, rows sum to 1.
    """
    if drift == 0.0:
        drifted = np.eye(_N)
    elif drift <= _SERIES_LIMIT:
        poisson = np.exp(_ORDER * math.log(2.0 * drift) - 2.0 * drift - _LOG_FACTORIAL)
        drifted = (poisson @ _POWERS).reshape(_N, _N)
    else:
        decay = np.exp(min(drift, _STATIONARY) * _EIGENVALUES)
        drifted = (_EIGENVECTORS * decay) @ _EIGENVECTORS.T
    return math.exp(-jump) * drifted - math.expm1(-jump) / _N


class LevelFilter:
    """Bayes filter over the eleven levels, for measurements at any spacing.

    The level drifts to a neighbour at one rate and jumps anywhere at another (a tunnel's mouth).
    Probabilities are kept as logarithms. A measurement that comes late, with a stamp older than
    the newest taken in, is counted in ``late`` and ignored: the state no longer is what it
    measured. After a clock was set back, start a new filter.

    Parameters
    ----------
    drift_per_s:
        Rate of moves to the next level up, and of moves to the next level down, 1/s, ≥ 0.
    jump_per_s:
        Rate of jumps to a level drawn uniformly from all eleven, 1/s, ≥ 0.
    correlation_s:
        Time over which the errors of successive measurements stay alike, s, ≥ 0, because they
        see the same scene or share data. Of a measurement that comes Δt after another only what
        it says anew counts: its logarithms less ρ = exp(−Δt / correlation_s) of the other's, the
        innovation of a first-order autoregression; the same answer again counts as the fraction
        1 − ρ of one. 0: errors are independent and every measurement counts whole.
    shared:
        Least ρ, 0 to 1, of a measurement no more than ``SHARED_S`` after another, whatever the time
        between: successive windows of scans have most scans in common, be these rare or frequent.

    Raises
    ------
    InputError
        If a parameter is negative or not finite, or ``shared`` is more than 1.
    """

    def __init__(
        self,
        drift_per_s: float,
        jump_per_s: float,
        correlation_s: float = 0.0,
        shared: float = 0.0,
    ) -> None:
        for name, value in (
            ("drift_per_s", drift_per_s),
            ("jump_per_s", jump_per_s),
            ("correlation_s", correlation_s),
            ("shared", shared),
        ):
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(name, f"is {value}", "expected a finite number, 0 or more")
        if shared > 1.0:
            raise InputError("shared", f"is {shared}", "expected 0 to 1")
        self.drift_per_s = drift_per_s
        self.jump_per_s = jump_per_s
        self.correlation_s = correlation_s
        self.shared = shared
        self.late = 0
        self._stamp_ns: int | None = None
        self._log: FloatArray = np.full(_N, -math.log(_N))
        self._measured: FloatArray = np.zeros(_N)

    def update(self, stamp_ns: int, probabilities: ArrayLike) -> FloatArray:
        """Take in one measurement.

        Parameters
        ----------
        stamp_ns:
            Its moment of capture, integer nanoseconds.
        probabilities:
            (11,) what the measurement alone says, under a uniform prior; ≥ 0, need not sum to 1.

        Returns
        -------
        (11,) float64, the filtered probabilities at ``stamp_ns``; at the newest stamp if this
        one came late.

        Raises
        ------
        InputError
            If ``probabilities`` are not eleven finite non-negative numbers of which one is not 0.
        """
        measured = np.asarray(probabilities, dtype=np.float64)
        if measured.shape != (_N,) or not np.all(np.isfinite(measured) & (measured >= 0.0)):
            raise InputError("probabilities", "are not 11 finite numbers of 0 or more")
        if not measured.any():
            raise InputError("probabilities", "are all 0")
        if self._stamp_ns is not None and stamp_ns < self._stamp_ns:
            self.late += 1
            return np.exp(self._log)
        evidence = self._evidence(stamp_ns, measured)
        prior = self._predicted(stamp_ns)
        posterior = prior + evidence
        # A level that cannot be reached was measured with certainty: the measurement stands.
        self._log = _normalised(posterior if np.isfinite(posterior).any() else evidence)
        self._stamp_ns = stamp_ns
        return np.exp(self._log)

    def predict(self, stamp_ns: int) -> FloatArray:
        """Return the (11,) probabilities at a later time without a measurement.

        They widen with time towards uniform. For a time before the newest measurement they are
        those at the newest measurement; before the first one they are uniform.
        """
        return np.exp(self._predicted(stamp_ns))

    def _elapsed_s(self, stamp_ns: int) -> float:
        if self._stamp_ns is None:
            return 0.0
        return max(0, stamp_ns - self._stamp_ns) * 1e-9

    def _evidence(self, stamp_ns: int, measured: FloatArray) -> FloatArray:
        """Return the logarithms of what a measurement says anew."""
        if self.correlation_s == self.shared == 0.0:
            with np.errstate(divide="ignore"):
                return np.asarray(np.log(measured))
        log = np.log(np.maximum(measured / measured.sum(), _LEAST))
        known, self._measured = self._measured, log
        return np.asarray(log - self._alike(self._elapsed_s(stamp_ns)) * known)

    def _alike(self, elapsed_s: float) -> float:
        """Return how much of a measurement's errors are those of another so long before."""
        shared = self.shared if elapsed_s <= SHARED_S else 0.0
        if self.correlation_s == 0.0:
            return shared
        return max(shared, math.exp(-elapsed_s / self.correlation_s))

    def _predicted(self, stamp_ns: int) -> FloatArray:
        elapsed_s = self._elapsed_s(stamp_ns)
        if elapsed_s == 0.0:
            return self._log
        moves = transition(self.drift_per_s * elapsed_s, self.jump_per_s * elapsed_s)
        with np.errstate(divide="ignore"):
            log: FloatArray = np.logaddexp.reduce(np.log(moves) + self._log, axis=1)
        return _normalised(log)


def _normalised(log: FloatArray) -> FloatArray:
    """Shift logarithms so that their exponentials sum to 1."""
    shifted: FloatArray = log - log.max()
    return shifted - math.log(np.exp(shifted).sum())


_RATES = {"camera": (1.0, 1.0, 0.1, 0.0), "radar": (0.1, 0.05, 0.2, 0.7)}
"""Drift and jump, 1/s, correlation, s, and what successive measurements share.

Radar: chosen by the error at rest, after a step and on a ramp on simulated drives, and on the
schedule of ``murk demo`` with seeds 1 to 3, which it flatters; what is shared, at 14 Hz, serves
recorded windows at 2 Hz as well. Camera: of 108 settings on three clips and four kinds, one that is
fast after a step and on a ramp, steady at rest, and seldom surer than right; ``murk bench
estimate`` shows how they were weighed, on the same clips.
"""


def level_filter(sensor_type: str) -> LevelFilter:
    """Return a new filter with the rates of a sensor type, ``camera`` or ``radar``."""
    return LevelFilter(*_RATES[sensor_type])
