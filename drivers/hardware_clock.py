"""Stamps of a device's own clock, told in the system's time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_LARGEST_DRIFT = 100e-6
"""Between two quartz clocks, seconds a second."""
_CLOCK_STEP_NS = 100_000_000
"""A jump of the offset beyond this is no delay: one of the clocks was set."""


class HardwareClock:
    """Maps stamps of a device's clock to the system's.

    The system stamps a frame a varying delay after the device did, so their least difference is
    the offset between the clocks; it may rise again no faster than the clocks can drift.
    """

    def __init__(self) -> None:
        self._offset_ns: int | None = None
        self._last_ns = 0

    def to_system(
        self, hardware_ns: NDArray[np.int64], software_ns: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return stamps in the system's time.

        Parameters
        ----------
        hardware_ns, software_ns:
            (n,) int64, n at least 1: when the device and when the system stamped the same frames.
        """
        least_ns = int((software_ns - hardware_ns).min())
        now_ns = int(hardware_ns[-1])
        if self._offset_ns is None or abs(least_ns - self._offset_ns) > _CLOCK_STEP_NS:
            self._offset_ns = least_ns
        else:
            drift_ns = int(max(0, now_ns - self._last_ns) * _LARGEST_DRIFT)
            self._offset_ns = min(least_ns, self._offset_ns + drift_ns)
        self._last_ns = now_ns
        return hardware_ns + self._offset_ns
