"""No more effort than it takes: a glance while a camera's level is certain, or no look at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from models.estimate.camera import CameraEstimator, CameraHistory
from models.estimate.level import Estimate

GLANCE = 0.25
"""Share of the usual reading in a glance."""
SURE_STD = 2.0
"""Standard deviation, points of level, below which an estimate is certain."""
STEADY_POINTS = 3.0
"""Change of the level, points, up to which it is steady."""
LONGEST_REST_S = 0.1
"""Longest time without a look at a steady camera, s."""


class AdaptiveCamera:
    """Estimates successive frames of one camera.

    As long as the last estimate was certain, the next frame gets a glance, and a whole look only
    if the glance is not certain. After two certain estimates of the same level, frames are left
    out for up to ``LONGEST_REST_S``.
    """

    def __init__(self, camera: CameraEstimator) -> None:
        self._camera = camera
        self._sure = False
        self._steady = False
        self._level = -np.inf
        self._stamp_ns = 0
        self._history: CameraHistory | None = None

    def estimate(self, image: NDArray[np.uint8], stamp_ns: int) -> Estimate | None:
        """Return the estimate of the next frame, or None where it is left out.

        Parameters
        ----------
        image:
            (height, width, 3) uint8 BGR.
        stamp_ns:
            Its moment of capture, integer nanoseconds.
        """
        since_s = (stamp_ns - self._stamp_ns) * 1e-9
        if self._steady and 0 <= since_s < LONGEST_REST_S:
            return None
        estimate, self._history = self._look(image, stamp_ns)
        self._steady = self._sure and abs(estimate.level - self._level) < STEADY_POINTS
        self._level, self._stamp_ns = estimate.level, stamp_ns
        return estimate

    def _look(self, image: NDArray[np.uint8], stamp_ns: int) -> tuple[Estimate, CameraHistory]:
        """Return what a glance says where that is enough, else a whole look, and the history."""
        before = self._history
        if before and self._sure:
            glance, history = self._camera.estimate_next(before, image, stamp_ns, GLANCE)
            if glance.std < SURE_STD:
                return glance, history
            before = replace(history, exposure=before.exposure)  # the lens was looked at
        whole, history = self._camera.estimate_next(before, image, stamp_ns)
        self._sure = whole.std < SURE_STD
        return whole, history
