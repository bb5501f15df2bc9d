"""A window starts anew where its newest scans contradict it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.estimate.level import LEVELS, Estimate
from models.estimate.radar import RadarEstimator, contradict, overlap
from models.estimate.radar_window import CONTRADICTIONS, FOLLOWS, RECENT, WINDOW, ScanWindow
from models.evaluate.radar import degraded, radar_filter, simulated_drive
from models.world.radar import WorldRadar
from models.world.road import World

SEED = 2**31 + 3000  # of worlds that no training draws
STEP = 16


@pytest.fixture(scope="module")
def scans() -> tuple[RadarScan, ...]:
    return simulated_drive(SEED, 30, STEP + WINDOW).scans


def certain(level: int) -> Estimate:
    return Estimate(np.eye(len(LEVELS))[level], {"clean": 1.0})


class Scripted:
    """Answers 0 % to a window of more than ``RECENT`` scans, and another level to its newest."""

    kinds: tuple[str, ...] = ("clean",)

    def __init__(self, newest: int) -> None:
        self.newest = newest

    def run_each(self, inputs: Mapping[str, NDArray[np.float32]]) -> list[Estimate]:
        scans = np.rint(np.exp(inputs["window"][:, FOLLOWS + 1])).astype(int)
        return [certain(0 if count > RECENT else self.newest) for count in scans]


def test_contradicted_window_answers_from_its_newest_scans(scans: tuple[RadarScan, ...]) -> None:
    agreeing, contradicted = (RadarEstimator(Scripted(newest)).follow() for newest in (0, 7))
    first = 2 * RECENT + CONTRADICTIONS - 1  # of the answers before, the first RECENT agree
    levels = [(agreeing(scan).level, contradicted(scan).level) for scan in scans[: first + 2]]
    assert {calm for calm, _ in levels} == {0.0}
    assert [level for _, level in levels[RECENT:first]] == [0.0] * (first - RECENT)
    assert levels[first][1] == 70.0
    assert levels[first + 1][1] == 0.0


def test_restart_forgets_all_but_the_newest_scans(scans: tuple[RadarScan, ...]) -> None:
    window, fresh = ScanWindow(), ScanWindow()
    for scan in scans[:6]:
        window.add(scan)
        window.say(certain(3))
    assert window.said_before is not None
    window.restart()
    for scan in scans[6 - RECENT : 6]:
        fresh.add(scan)
    assert window.said_before is None
    after, expected = window.add(scans[6]), fresh.add(scans[6])
    assert after is not None
    assert expected is not None
    np.testing.assert_array_equal(after, expected)


def test_newest_scans_are_compared_with_what_was_said_before_them(
    scans: tuple[RadarScan, ...],
) -> None:
    window = ScanWindow()
    for number, scan in enumerate(scans[:6]):
        window.add(scan)
        before = window.said_before
        assert before is None if number < RECENT else before is not None
        if before:
            assert before.level == 10.0 * (number - RECENT)
        window.say(certain(number))


@pytest.mark.parametrize(("before", "after"), [(0.0, 80.0), (80.0, 0.0), (20.0, 60.0)])
def test_level_follows_a_step_within_a_few_scans(
    scans: tuple[RadarScan, ...], before: float, after: float
) -> None:
    """Four scans after it the level is there; without a restart the window still mixes both."""
    estimator = RadarEstimator()
    follow, mixing = estimator.follow(), estimator.follow(WINDOW)
    for number, scan in enumerate(scans[: STEP + 5]):
        noisy = degraded(scan, "snr", before if number < STEP else after, seed=5)
        answer, mixed = follow(noisy), mixing(noisy)
    assert answer.level == pytest.approx(after, abs=12)
    assert abs(mixed.level - after) > abs(answer.level - after) + 10


@pytest.mark.parametrize("level", [0.0, 40.0, 100.0])
def test_steady_level_is_answered_from_the_whole_window(
    scans: tuple[RadarScan, ...], level: float
) -> None:
    estimator = RadarEstimator()
    follow, never = estimator.follow(), estimator.follow(WINDOW)
    for scan in scans:
        noisy = degraded(scan, "snr", level, seed=6)
        np.testing.assert_array_equal(follow(noisy).probabilities, never(noisy).probabilities)


def test_clean_drive_whose_newest_scans_are_doubtful_stays_clean() -> None:
    """Some scans before a tunnel of this world look like no kind that was trained."""
    radar, levels = WorldRadar(World(1, 20.0)), radar_filter()
    follow = RadarEstimator().follow()
    estimates = [(scan, follow(scan)) for scan in map(radar.scan, range(50, 84))]
    filtered = [levels.update(scan.stamp_ns, each.probabilities) for scan, each in estimates]
    assert max(each.std for _, each in estimates[WINDOW:]) > 20.0
    assert max(each @ LEVELS for each in filtered[WINDOW:]) < 8.0


weights = arrays(np.float64, len(LEVELS), elements=st.floats(0.0, 1.0)).filter(np.any)


@settings(max_examples=50)
@given(one=weights, other=weights)
def test_overlap_is_1_for_equal_distributions_and_less_for_others(
    one: NDArray[np.float64], other: NDArray[np.float64]
) -> None:
    a, b = (Estimate(each / each.sum(), {"clean": 1.0}) for each in (one, other))
    assert overlap(a, a) == pytest.approx(1.0)
    assert overlap(a, b) == overlap(b, a)
    assert -1e-12 <= overlap(a, b) <= 1.0 + 1e-12
    assert overlap(certain(2), certain(3)) == 0.0


def test_to_mean_the_level_beside_it_is_no_contradiction() -> None:
    surely_2, rather_3 = (
        Estimate(np.eye(len(LEVELS))[2] * two + np.eye(len(LEVELS))[3] * (1 - two), {"clean": 1.0})
        for two in (0.99, 0.3)
    )
    assert not contradict(surely_2, surely_2)
    assert not contradict(surely_2, rather_3)
    assert contradict(surely_2, certain(4))
    assert contradict(certain(2), certain(3))
