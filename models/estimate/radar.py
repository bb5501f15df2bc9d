"""The radar's noise level and kind: from one scan, or from a scan and those before it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from drivers.scan import RadarScan
from models.estimate.level import LEVELS, Estimate
from models.estimate.network import WEIGHTS, Network
from models.estimate.radar_window import INPUTS, RECENT, VERSION, ScanWindow

LEAST_OVERLAP = 0.45
"""Overlap of what the newest scans say with what those before them said; below it, they contradict.

Chosen on drives of 60 simulated worlds, 20 s and two steps each: for a small error after the steps,
and few windows that start anew without one. See ``docs/estimate.md``.
"""


class RadarNetwork(Protocol):
    """What answers to the inputs of a window; see ``models.estimate.network.Network``."""

    kinds: tuple[str, ...]

    def run_each(self, inputs: Mapping[str, NDArray[np.float32]]) -> list[Estimate]:
        """Return the estimate for each of several windows."""


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
                inputs={"window": (2, INPUTS)},
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
        return self.estimate_next(ScanWindow(), scan)

    def follow(self, recent: int = RECENT) -> Callable[[RadarScan], Estimate]:
        """Return a function that estimates successive scans of one sensor, for one thread.

        Each answer rests on the scan and those shortly before it; see ``ScanWindow``. The first
        one is that of ``estimate``. Where the newest scans alone contradict what was answered
        before them, twice in a row, the level has changed, and the window starts anew with them.

        Parameters
        ----------
        recent:
            Number of these newest scans; ``WINDOW``: the window never starts anew.
        """
        window = ScanWindow(recent)

        def estimate(scan: RadarScan) -> Estimate:
            return self.estimate_next(window, scan)

        return estimate

    def estimate_next(self, window: ScanWindow, scan: RadarScan) -> Estimate:
        """Return what a window says once the next scan is in it; see ``follow``."""
        check_clusters(scan)
        inputs = window.add(scan)
        if inputs is None:
            kinds = self._network.kinds
            return Estimate(
                probabilities=np.full(len(LEVELS), 1 / len(LEVELS)),
                kind_probabilities=dict.fromkeys(kinds, 1 / len(kinds)),
            )
        whole, newest = self._network.run_each({"window": inputs})
        before = window.said_before
        if window.contradicted(before is not None and contradict(before, newest)):
            window.restart()
            whole = newest
        window.say(whole)
        return whole


def contradict(before: Estimate, newest: Estimate) -> bool:
    """Tell whether the newest scans alone contradict what was answered before them.

    The earlier answer's probabilities count by their square roots: it rests on more scans and is
    far surer of one level than few can be, and to mean the one beside it is no contradiction.
    """
    roots = np.sqrt(before.probabilities)
    return overlap(replace(before, probabilities=roots / roots.sum()), newest) < LEAST_OVERLAP


def overlap(one: Estimate, other: Estimate) -> float:
    """Return how far two distributions of the level agree: 1 if they are equal, 0 if disjoint.

    Bhattacharyya, "On a measure of divergence between two statistical populations defined by their
    probability distributions", 1943.
    """
    return float(np.sqrt(one.probabilities * other.probabilities).sum())


def check_clusters(scan: RadarScan) -> None:
    """Raise InputError unless the scan is in cluster mode."""
    if scan.mode != "cluster":
        raise InputError(
            f"scan of {scan.sensor}",
            "in object mode, whose tracker hides the noise",
            "set the radar to cluster mode (RadarCfg_OutputType 2)",
        )
