"""A radar's scans are left out only where nothing can have happened."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dbc.errors import InputError
from drivers.scan import RadarScan
from models.estimate.level import Estimate
from models.estimate.radar import RadarEstimator
from models.estimate.radar_adaptive import LONGEST_REST_S, AdaptiveRadar
from models.estimate.radar_window import ScanWindow
from models.evaluate.radar import simulated_drive


class Scripted(RadarEstimator):
    """Says of each scan what it is told to: level, and whether it is sure."""

    def __init__(self) -> None:
        self.level, self.sure, self.doubt = 40.0, True, False

    def estimate_next(self, window: ScanWindow, scan: RadarScan) -> Estimate:
        window.contradicted(self.doubt)
        probabilities = np.eye(11)[int(self.level / 10)] if self.sure else np.full(11, 1 / 11)
        return Estimate(probabilities, {"clean": 1.0})


@pytest.fixture(scope="module")
def scans() -> tuple[RadarScan, ...]:
    return simulated_drive(2**31 + 4001, 20, 12).scans


def looked(adaptive: AdaptiveRadar, scans: tuple[RadarScan, ...]) -> list[int]:
    return [n for n, scan in enumerate(scans) if adaptive.estimate(scan) is not None]


def test_steady_and_certain_every_second_scan_is_left_out(scans: tuple[RadarScan, ...]) -> None:
    assert looked(AdaptiveRadar(Scripted()), scans[:9]) == [0, 1, 3, 5, 7]


def test_uncertain_doubtful_or_moving_level_is_always_looked_at(
    scans: tuple[RadarScan, ...],
) -> None:
    radar = Scripted()
    radar.sure = False
    assert looked(AdaptiveRadar(radar), scans) == list(range(len(scans)))
    radar.sure, radar.doubt = True, True
    assert looked(AdaptiveRadar(radar), scans) == list(range(len(scans)))
    radar.doubt = False
    adaptive = AdaptiveRadar(radar)
    for number, scan in enumerate(scans):
        radar.level = 20.0 * (number % 5)
        assert adaptive.estimate(scan) is not None


def test_other_number_of_clusters_is_looked_at(scans: tuple[RadarScan, ...]) -> None:
    adaptive = AdaptiveRadar(Scripted())
    for scan in scans[:2]:
        adaptive.estimate(scan)
    columns: dict[str, Any] = {name: values[:90] for name, values in scans[2].arrays().items()}
    assert adaptive.estimate(replace(scans[2], near=90, far=0, **columns)) is not None
    assert adaptive.estimate(scans[3]) is not None


@pytest.mark.parametrize("gap_s", [LONGEST_REST_S + 0.05, -1.0], ids=["rare", "back"])
def test_scan_after_a_gap_is_looked_at(scans: tuple[RadarScan, ...], gap_s: float) -> None:
    adaptive = AdaptiveRadar(Scripted())
    for scan in scans[:2]:
        adaptive.estimate(scan)
    later = replace(scans[2], stamp_ns=scans[1].stamp_ns + round(gap_s * 1e9))
    assert adaptive.estimate(later) is not None


def test_object_mode_is_refused_even_while_steady(scans: tuple[RadarScan, ...]) -> None:
    adaptive = AdaptiveRadar(RadarEstimator())
    assert len(looked(adaptive, scans[:9])) < 9
    with pytest.raises(InputError, match="object mode"):
        adaptive.estimate(replace(scans[9], mode="object"))
