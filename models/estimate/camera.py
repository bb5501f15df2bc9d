"""The camera's noise level and kind from one frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.estimate.image_features import FEATURES, image_features
from models.estimate.level import Estimate
from models.estimate.network import WEIGHTS, Network

VERSION = 4
"""Version of the features; raised whenever ``image_features`` changes what it returns."""


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
            inputs={"features": (1, FEATURES)},
        )

    def estimate(self, image: NDArray[np.uint8], effort: float = 1.0) -> Estimate:
        """Return level and kind of one frame.

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
        estimate = self._network.run({"features": image_features(image, effort)[np.newaxis]})
        return replace(estimate, effort=effort)
