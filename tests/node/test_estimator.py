"""The estimator of one sensor in a live run: a window fills, and a step is followed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.frame import Frame
from drivers.scan import RadarScan
from models.estimate.lens import LOG_RATIOS
from models.estimate.level import LENS_KINDS, LENS_ODDS, NoiseLevel
from models.evaluate.radar import degraded, simulated_drive
from models.world.camera import WorldCamera
from models.world.road import World
from node.estimator import Estimator, load_network

SEED = 2**31 + 4000  # of a world that no training draws


def level_of(estimator: Estimator, message: RadarScan | Frame) -> NoiseLevel:
    return estimator.estimate(message, arrival_ns=0, injected=None, dropped=0)


def test_radar_is_estimated_from_a_window_that_fills() -> None:
    clean = simulated_drive(SEED, 50, 14).scans
    estimator, alone = Estimator("radar"), load_network("radar")
    noisy = [degraded(scan, "snr", 50.0, seed=1) for scan in clean]
    answers = [level_of(estimator, scan) for scan in noisy]
    assert answers[0].raw == alone(noisy[0]).level
    assert answers[-1].raw != alone(noisy[-1]).level
    assert answers[-1].std < answers[0].std
    assert abs(answers[-1].level - 50.0) < 10.0


def test_step_is_followed_within_two_seconds() -> None:
    clean = simulated_drive(SEED + 1, 50, 56).scans
    estimator = Estimator("radar")
    for index, scan in enumerate(clean):
        last = level_of(estimator, degraded(scan, "snr", 70.0 * (index >= 28), seed=2))
        if index == 27:
            assert last.level < 10.0
            assert last.kind == "clean"
    assert abs(last.level - 70.0) < 12.0


def test_same_scans_same_answers_whatever_came_before_a_long_silence() -> None:
    clean = simulated_drive(SEED + 2, 50, 4).scans
    later = [replace(scan, stamp_ns=scan.stamp_ns + 3600 * 10**9) for scan in clean]
    fresh, used = Estimator("radar"), Estimator("radar")
    for scan in clean:
        level_of(used, degraded(scan, "snr", 90.0, seed=3))
    for scan in later:
        first, second = level_of(fresh, scan), level_of(used, scan)
        assert first.raw == second.raw
        np.testing.assert_allclose(first.probabilities, second.probabilities, atol=1e-6)


@pytest.mark.parametrize("adaptive", [False, True])
def test_a_clock_set_back_does_not_hold_the_level(adaptive: bool) -> None:
    clean = simulated_drive(SEED + 3, 50, 28).scans
    estimator = Estimator("radar", adaptive=adaptive)
    for index, scan in enumerate(clean):
        later_ns = 0 if index >= 14 else 3600 * 10**9
        noisy = degraded(scan, "snr", 80.0 * (index >= 14), seed=4)
        last = level_of(estimator, replace(noisy, stamp_ns=scan.stamp_ns + later_ns))
        if index == 13:
            assert last.level < 10.0
    assert abs(last.level - 80.0) < 15.0


def test_a_message_a_little_late_changes_nothing() -> None:
    clean = simulated_drive(SEED + 3, 50, 3).scans
    estimator = Estimator("radar")
    level_of(estimator, clean[0])
    before = level_of(estimator, clean[2])
    after = level_of(estimator, degraded(clean[1], "snr", 100.0, seed=5))
    np.testing.assert_array_equal(after.probabilities, before.probabilities)


def test_what_the_lens_says_reaches_the_published_level_and_is_no_news_in_every_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Drops that are likelier than not stay so: the filter in time does not count them again."""
    lens = np.full(LOG_RATIOS, -30.0)
    lens[LENS_KINDS.index("drops"), 5:] = np.log(3.0 / LENS_ODDS)
    monkeypatch.setattr("models.estimate.lens.LensNetwork.log_ratios", lambda *_: lens)
    estimator = Estimator("camera")
    camera = WorldCamera(World(4, 4.0), width=320, height=180, rate_hz=10.0)
    said = [level_of(estimator, frame) for frame in camera.frames()]
    assert said[0].kind == "clean"
    for level in said[-10:]:
        assert level.kind == "drops"
        assert 0.5 < level.kind_probabilities["drops"] < 0.7
        assert level.level == pytest.approx(0.6 * 80, abs=5)
        assert level.std > 25
        assert level.raw == pytest.approx(level.level, abs=3)
