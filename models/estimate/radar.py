"""The radar's noise level and kind from one scan."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dbc.errors import InputError
from drivers.scan import RadarScan
from models.estimate.level import LEVELS, Estimate
from models.estimate.network import WEIGHTS, Network
from models.estimate.radar_features import FEATURES, VERSION, features


class RadarEstimator:
    """Estimates how degraded a scan is; safe to share between threads.

    Parameters
    ----------
    path:
        A network made by ``murk train radar``; the one that murk ships when None.

    Raises
    ------
    ModelError
        If the file is missing, corrupt or not a radar network of this version.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._network = Network(
            path or WEIGHTS / "radar.onnx",
            model="radar",
            version=VERSION,
            inputs={"features": (1, FEATURES)},
        )

    def estimate(self, scan: RadarScan) -> Estimate:
        """Return level and kind of one scan in cluster mode, with or without quality fields.

        A scan without clusters holds no evidence: every level and every kind is equally likely.

        Raises
        ------
        InputError
            If the scan is in object mode.
        """
        check_clusters(scan)
        if not len(scan):
            kinds = self._network.kinds
            return Estimate(
                probabilities=np.full(len(LEVELS), 1 / len(LEVELS)),
                kind_probabilities=dict.fromkeys(kinds, 1 / len(kinds)),
            )
        return self._network.run({"features": features(scan)[np.newaxis]})


def check_clusters(scan: RadarScan) -> None:
    """Raise InputError unless the scan is in cluster mode."""
    if scan.mode != "cluster":
        raise InputError(
            f"scan of {scan.sensor}",
            "in object mode, whose tracker hides the noise",
            "set the radar to cluster mode (RadarCfg_OutputType 2)",
        )
