"""The radar's noise level and kind: from one scan, or from a scan and those before it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from drivers.scan import RadarScan
from models.estimate.level import LEVELS, Estimate
from models.estimate.network import WEIGHTS, Network
from models.estimate.radar_window import INPUTS, VERSION, ScanWindow


class RadarNetwork(Protocol):
    """What answers to the inputs of a window; see ``models.estimate.network.Network``."""

    kinds: tuple[str, ...]

    def run(self, inputs: Mapping[str, NDArray[np.float32]]) -> Estimate:
        """Return the estimate for one window."""


class RadarEstimator:
    """Estimates how degraded a scan is; safe to share between threads.

    Parameters
    ----------
    network:
        A file made by ``murk train radar``, or a network; the one that murk ships when None.

    Raises
    ------
    ModelError
        If the file is missing, corrupt or not a radar network of this version.
    """

    def __init__(self, network: Path | RadarNetwork | None = None) -> None:
        if network is None or isinstance(network, Path):
            network = Network(
                network or WEIGHTS / "radar.onnx",
                model="radar",
                version=VERSION,
                inputs={"window": (1, INPUTS)},
            )
        self._network = network

    def estimate(self, scan: RadarScan) -> Estimate:
        """Return level and kind of one scan in cluster mode, with or without quality fields.

        A scan without clusters holds no evidence: every level and every kind is equally likely.

        Raises
        ------
        InputError
            If the scan is in object mode.
        """
        return self._estimate(ScanWindow(), scan)

    def follow(self) -> Callable[[RadarScan], Estimate]:
        """Return a function that estimates successive scans of one sensor, for one thread.

        Each answer rests on the scan and those shortly before it; see ``ScanWindow``. The first
        one is that of ``estimate``.
        """
        window = ScanWindow()

        def estimate(scan: RadarScan) -> Estimate:
            return self._estimate(window, scan)

        return estimate

    def _estimate(self, window: ScanWindow, scan: RadarScan) -> Estimate:
        check_clusters(scan)
        inputs = window.add(scan)
        if inputs is None:
            kinds = self._network.kinds
            return Estimate(
                probabilities=np.full(len(LEVELS), 1 / len(LEVELS)),
                kind_probabilities=dict.fromkeys(kinds, 1 / len(kinds)),
            )
        return self._network.run({"window": inputs[np.newaxis]})


def check_clusters(scan: RadarScan) -> None:
    """Raise InputError unless the scan is in cluster mode."""
    if scan.mode != "cluster":
        raise InputError(
            f"scan of {scan.sensor}",
            "in object mode, whose tracker hides the noise",
            "set the radar to cluster mode (RadarCfg_OutputType 2)",
        )
