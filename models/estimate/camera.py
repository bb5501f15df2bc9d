"""The camera's noise level and kind from one frame, or from successive ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.estimate.exposure import SEEN, UNSEEN, ExposureHistory, seen_before
from models.estimate.image_features import FEATURES, exposure, image_features
from models.estimate.level import Estimate
from models.estimate.network import WEIGHTS, Network

VERSION = 5
"""Version of the inputs; raised whenever ``image_features`` or ``exposure`` change in meaning."""


class CameraEstimator:
    """Estimates how degraded a frame is; safe to share between threads.

    Parameters
    ----------
    path:
        A network made by ``murk train camera``; the one that murk ships when None.

    Raises
    ------
    ModelError
        If the file is missing, corrupt or not a camera network of this version.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._network = Network(
            path or WEIGHTS / "camera.onnx",
            model="camera",
            version=VERSION,
            inputs={"features": (1, FEATURES), "history": (1, SEEN)},
        )

    def estimate(self, image: NDArray[np.uint8], effort: float = 1.0) -> Estimate:
        """Return level and kind of one frame by itself.

        Parameters
        ----------
        image:
            (height, width, 3) uint8 BGR of any size from 1×1 up.
        effort:
            Share of the usual reading, > 0; less is faster and less sure.

        Raises
        ------
        InputError
            If the array is no such image.
        """
        return self._answer(image_features(image, effort), UNSEEN, effort)

    def estimate_next(
        self,
        history: ExposureHistory | None,
        image: NDArray[np.uint8],
        stamp_ns: int,
        effort: float = 1.0,
    ) -> tuple[Estimate, ExposureHistory]:
        """Return level and kind of one camera's next frame, and the history with that frame.

        Parameters
        ----------
        history:
            Of the frames of the same camera before it; None before the first.
        image, effort:
            As for ``estimate``.
        stamp_ns:
            Moment of capture, integer nanoseconds.

        Raises
        ------
        InputError
            If the array is no such image.
        """
        features = image_features(image, effort)
        exposed = exposure(features)
        estimate = self._answer(features, seen_before(history, stamp_ns, exposed), effort)
        if history is None:
            return estimate, ExposureHistory.begin(stamp_ns, exposed)
        return estimate, history.after(stamp_ns, exposed)

    def follow(self) -> Callable[[NDArray[np.uint8], int], Estimate]:
        """Return a function that estimates successive frames of one camera, for one thread.

        It takes a frame and its moment of capture, as ``estimate_next`` does, and keeps the history
        itself.
        """
        history: ExposureHistory | None = None

        def estimate(image: NDArray[np.uint8], stamp_ns: int) -> Estimate:
            nonlocal history
            answer, history = self.estimate_next(history, image, stamp_ns)
            return answer

        return estimate

    def _answer(
        self, features: NDArray[np.float32], seen: NDArray[np.float32], effort: float
    ) -> Estimate:
        inputs = {"features": features[np.newaxis], "history": seen[np.newaxis]}
        return replace(self._network.run(inputs), effort=effort)
