"""From one message to the sensor's noise level: the network, then the filters in time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import monotonic_ns
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.frame import Frame
from drivers.scan import RadarScan
from models.estimate.calibration import Calibration
from models.estimate.filter import level_filter
from models.estimate.level import Estimate, NoiseLevel
from models.estimate.smooth import KindFilter, agreeing
from node.pace import CLOCK_STEP_NS
from node.scene import SensorType

KIND_TIME_CONSTANT_S = 0.3


def load_network(sensor_type: SensorType) -> Callable[[Any], Estimate]:
    """Return the network of a sensor type, as a function from Frame or RadarScan to its estimate.

    Every message is estimated by itself.

    Raises
    ------
    ModelError
        If the network's file is missing or not murk's.
    """
    if sensor_type == "camera":
        from models.estimate.camera import CameraEstimator

        camera = CameraEstimator()

        def estimate_frame(frame: Frame) -> Estimate:
            return camera.estimate(frame.image)

        return estimate_frame
    from models.estimate.radar import RadarEstimator

    radar = RadarEstimator()

    def estimate_scan(scan: RadarScan) -> Estimate:
        return radar.estimate(scan)

    return estimate_scan


def load_adaptive(sensor_type: SensorType) -> Callable[[Any], Estimate | None]:
    """Return a function from one sensor's successive messages to estimates; None: left out.

    Raises
    ------
    ModelError
        If the network's file is missing or not murk's.
    """
    if sensor_type == "radar":
        from models.estimate.radar import RadarEstimator
        from models.estimate.radar_adaptive import AdaptiveRadar

        return AdaptiveRadar(RadarEstimator()).estimate
    from models.estimate.adaptive import AdaptiveCamera
    from models.estimate.camera import CameraEstimator

    camera = AdaptiveCamera(CameraEstimator())

    def look(frame: Frame) -> Estimate | None:
        return camera.estimate(frame.image, frame.stamp_ns)

    return look


def load_follower(sensor_type: SensorType) -> Callable[[Any], Estimate]:
    """Return the same for the successive messages of one sensor.

    A scan is estimated with those before it, a frame with the history of the camera's exposure and
    of its lens.

    Raises
    ------
    ModelError
        If the network's file is missing or not murk's.
    """
    if sensor_type == "camera":
        from models.estimate.camera import CameraEstimator

        next_frame = CameraEstimator().follow()

        def estimate_frame(frame: Frame) -> Estimate:
            return next_frame(frame.image, frame.stamp_ns)

        return estimate_frame
    from models.estimate.radar import RadarEstimator

    return RadarEstimator().follow()


class Estimator:
    """Estimates the noise level of one sensor, message by message.

    Parameters
    ----------
    calibration:
        A file of ``murk calibrate`` that corrects this sensor's estimates.
    adaptive:
        Whether frames are only glanced at while a camera's level is certain, and messages left out
        while it, or a radar's, is steady.

    Raises
    ------
    ModelError
        If the network's file is missing or not murk's.
    InputError
        If the calibration's file is.
    """

    def __init__(
        self, sensor_type: SensorType, calibration: Path | None = None, *, adaptive: bool = False
    ) -> None:
        self._look: Callable[[Any], Estimate | None] = (
            load_adaptive(sensor_type) if adaptive else load_follower(sensor_type)
        )
        self._correction = Calibration.read(calibration, sensor_type) if calibration else None
        self._sensor_type = sensor_type
        self._raw = 0.0
        self._start_anew()

    def _start_anew(self) -> None:
        """Forget what the filters know, whose stamps are of another time."""
        self._levels = level_filter(self._sensor_type)
        self._kinds = KindFilter(KIND_TIME_CONSTANT_S)
        self._newest_ns: int | None = None
        self._lens: NDArray[np.float64] | None = None

    def estimate(
        self,
        message: Any,
        *,
        arrival_ns: int,
        injected: dict[str, float] | None,
        dropped: int,
    ) -> NoiseLevel:
        """Return the noise level at a Frame or RadarScan.

        Where the sensor's clock was set back, the filters start anew.

        Parameters
        ----------
        arrival_ns:
            When the message reached the node, by the monotonic clock, nanoseconds.
        injected, dropped:
            The message's history; see ``NoiseLevel``.
        """
        if self._newest_ns is not None and message.stamp_ns < self._newest_ns - CLOCK_STEP_NS:
            self._start_anew()
        self._newest_ns = max(message.stamp_ns, self._newest_ns or message.stamp_ns)
        estimate = self._look(message)
        if estimate is None:
            probabilities = self._levels.predict(message.stamp_ns)
            weights, raw, effort = self._kinds.probabilities, self._raw, 0.0
        else:
            if self._correction is not None:
                estimate = self._correction.apply(estimate)
            probabilities = self._levels.update(message.stamp_ns, estimate.probabilities)
            weights = self._kinds.update(message.stamp_ns, estimate.kind_probabilities)
            self._lens = estimate.lens
            self._raw = raw = estimate.with_lens().level
            effort = estimate.effort
        kinds = agreeing(weights, float(probabilities[0]))
        filtered = Estimate(probabilities, kinds, effort, self._lens).with_lens()
        return NoiseLevel(
            sensor=message.sensor,
            stamp_ns=message.stamp_ns,
            level=filtered.level,
            std=filtered.std,
            probabilities=filtered.probabilities,
            kind=filtered.kind,
            kind_probabilities=filtered.kind_probabilities,
            raw=raw,
            injected=injected,
            latency_ns=monotonic_ns() - arrival_ns,
            sequence=message.sequence,
            dropped=dropped,
            effort=effort,
        )
