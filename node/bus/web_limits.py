"""How often somebody may do something: a burst, then a steady rate."""

from __future__ import annotations

from collections import OrderedDict
from time import monotonic

ADDRESSES_KEPT = 256


class RateLimit:
    """A token bucket: ``burst`` at once, then ``rate_hz`` a second."""

    def __init__(self, rate_hz: float, burst: float) -> None:
        self._rate_hz = rate_hz
        self._burst = burst
        self._left = burst
        self._last_s = monotonic()

    def exhausted(self) -> bool:
        """Tell whether none is left."""
        now = monotonic()
        self._left = min(self._burst, self._left + (now - self._last_s) * self._rate_hz)
        self._last_s = now
        return self._left < 1

    def allows(self) -> bool:
        """Take one; False where none is left."""
        if self.exhausted():
            return False
        self._left -= 1
        return True


class RateLimits:
    """A ``RateLimit`` an address; of those not seen for longest, the limits are forgotten."""

    def __init__(self, rate_hz: float, burst: float) -> None:
        self._rate_hz = rate_hz
        self._burst = burst
        self._limits: OrderedDict[str, RateLimit] = OrderedDict()

    def exhausted(self, address: str) -> bool:
        """Tell whether an address has none left."""
        return self._of(address).exhausted()

    def allows(self, address: str) -> bool:
        """Take one for an address; False where it has none left."""
        return self._of(address).allows()

    def _of(self, address: str) -> RateLimit:
        limit = self._limits.setdefault(address, RateLimit(self._rate_hz, self._burst))
        self._limits.move_to_end(address)
        if len(self._limits) > ADDRESSES_KEPT:
            self._limits.popitem(last=False)
        return limit
