"""The camera's noise level and kind from one frame, or from successive ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.estimate.exposure import SEEN, UNSEEN, ExposureHistory, seen_before
from models.estimate.image_features import FEATURES, exposure, image_features
from models.estimate.lens import LensHistory, LensNetwork
from models.estimate.level import CAMERA_KINDS, Estimate
from models.estimate.network import WEIGHTS, Network

VERSION = 5
"""Version of the inputs; raised whenever ``image_features`` or ``exposure`` change in meaning."""

_CLEAR = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class CameraHistory:
    """What one camera's frames up to the newest tell of the next one.

    Attributes
    ----------
    exposure:
        How they were exposed.
    lens:
        What stood still in them.
    log_ratios:
        What the lens's network says of that; see ``LensNetwork.log_ratios``. None as long as only
        one frame was looked at, in which everything stands still.
    """

    exposure: ExposureHistory
    lens: LensHistory
    log_ratios: NDArray[np.float64] | None


class CameraEstimator:
    """Estimates how degraded a frame is; safe to share between threads.

    Parameters
    ----------
    path:
        A network made by ``murk train camera``; the one that murk ships when None.
    lens:
        A network made by ``murk train lens``; the one that murk ships when None.

    Raises
    ------
    ModelError
        If a file is missing, corrupt or not such a network of this version.
    """

    def __init__(self, path: Path | None = None, lens: Path | None = None) -> None:
        self._lens = LensNetwork(lens)
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
        history: CameraHistory | None,
        image: NDArray[np.uint8],
        stamp_ns: int,
        effort: float = 1.0,
    ) -> tuple[Estimate, CameraHistory]:
        """Return level and kind of one camera's next frame, and the history with that frame.

        What the frames say of the lens is apart, in ``Estimate.lens``; those that are degraded by
        themselves are left out of it.

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
        before = history.exposure if history else None
        estimate = self._answer(features, seen_before(before, stamp_ns, exposed), effort)
        if history is None:
            begun = ExposureHistory.begin(stamp_ns, exposed)
            return estimate, CameraHistory(begun, LensHistory.begin(stamp_ns, image), None)
        after = self._look_at_lens(history, image, stamp_ns) if _shows_lens(estimate) else history
        exposure_after = history.exposure.after(stamp_ns, exposed)
        if exposure_after is not history.exposure:
            after = replace(after, exposure=exposure_after)
        return replace(estimate, lens=after.log_ratios), after

    def _look_at_lens(
        self, history: CameraHistory, image: NDArray[np.uint8], stamp_ns: int
    ) -> CameraHistory:
        """Return the history once the lens was looked at, where that is due."""
        lens = history.lens.after(stamp_ns, image)
        if lens is history.lens:
            return history
        log_ratios = self._lens.log_ratios(lens) if lens.age_s else None
        return CameraHistory(history.exposure, lens, log_ratios)

    def follow(self) -> Callable[[NDArray[np.uint8], int], Estimate]:
        """Return a function that estimates successive frames of one camera, for one thread.

        It takes a frame and its moment of capture, as ``estimate_next`` does, and keeps the history
        itself.
        """
        history: CameraHistory | None = None

        def estimate(image: NDArray[np.uint8], stamp_ns: int) -> Estimate:
            nonlocal history
            answer, history = self.estimate_next(history, image, stamp_ns)
            return answer

        return estimate

    def _answer(
        self, features: NDArray[np.float32], seen: NDArray[np.float32], effort: float
    ) -> Estimate:
        inputs = {"features": features[np.newaxis], "history": seen[np.newaxis]}
        answer = self._network.run(inputs)
        kinds = dict.fromkeys(CAMERA_KINDS, 0.0) | answer.kind_probabilities
        return replace(answer, kind_probabilities=kinds, effort=effort)


def _shows_lens(estimate: Estimate) -> bool:
    """Tell whether a frame is clear enough to be looked at for what is on the lens."""
    kinds = estimate.kind_probabilities
    return kinds["clean"] + kinds["dirt"] > _CLEAR
