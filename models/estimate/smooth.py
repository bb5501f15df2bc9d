"""The kind in time: an exponential average of its probabilities, exact at any spacing."""

from __future__ import annotations

import math


class KindFilter:
    """Averages the probabilities of the kinds over a time constant.

    Parameters
    ----------
    time_constant_s:
        Time after which a new kind has 63 % of the weight, s, > 0.
    """

    def __init__(self, time_constant_s: float) -> None:
        self._time_constant_s = time_constant_s
        self._stamp_ns: int | None = None
        self._probabilities: dict[str, float] = {}

    @property
    def probabilities(self) -> dict[str, float]:
        """The average at the newest measurement; empty before the first."""
        return self._probabilities

    def update(self, stamp_ns: int, probabilities: dict[str, float]) -> dict[str, float]:
        """Take in one measurement; return the average at ``stamp_ns`` (integer nanoseconds).

        A measurement older than the newest one has no weight.
        """
        if self._stamp_ns is None:
            self._stamp_ns, self._probabilities = stamp_ns, dict(probabilities)
            return self._probabilities
        elapsed_s = max(0, stamp_ns - self._stamp_ns) * 1e-9
        weight = -math.expm1(-elapsed_s / self._time_constant_s)
        self._stamp_ns = max(stamp_ns, self._stamp_ns)
        self._probabilities = {
            kind: (1.0 - weight) * self._probabilities.get(kind, 0.0) + weight * new
            for kind, new in probabilities.items()
        }
        return self._probabilities


def agreeing(kinds: dict[str, float], level_0: float) -> dict[str, float]:
    """Return probabilities of the kinds that agree with the level: clean is what level 0 means.

    Parameters
    ----------
    kinds:
        Probability by kind, ``clean`` among them.
    level_0:
        Probability that the level is 0 %; it becomes that of ``clean``. The other kinds share the
        rest in their own proportions, or evenly where they have none.
    """
    others = {kind: weight for kind, weight in kinds.items() if kind != "clean"}
    total = sum(others.values())
    shares = {kind: weight / total if total else 1 / len(others) for kind, weight in others.items()}
    return {"clean": level_0} | {kind: (1 - level_0) * share for kind, share in shares.items()}
