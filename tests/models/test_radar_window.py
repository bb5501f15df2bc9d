"""Evidence between scans: what it sees of noise, and what it must not see."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.estimate.radar import RadarEstimator
from models.estimate.radar_pairs import PAIR_FEATURES, carried, pair_features
from models.estimate.radar_view import view
from models.estimate.radar_window import (
    FOLLOWS,
    INPUTS,
    MAX_GAP_S,
    WINDOW,
    ScanWindow,
    evidence,
    inputs,
)
from models.evaluate.radar import degraded, recorded_drives, simulated_drive
from models.world.radar import WorldRadar
from models.world.road import World

SEED = 2**31 + 2000  # of worlds that no training draws


@pytest.fixture(scope="module")
def scans() -> tuple[RadarScan, ...]:
    return simulated_drive(SEED, 60, WINDOW + 6).scans


@pytest.fixture(scope="module")
def estimator() -> RadarEstimator:
    return RadarEstimator()


def disguised(scan: RadarScan, seed: int) -> RadarScan:
    """Return a scan in another order, with other IDs and quality, off the grid by a hair."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(scan))
    columns: dict[str, Any] = {name: values[order] for name, values in scan.arrays().items()}
    for name, step in {"x": 0.2, "y": 0.2, "vx": 0.25, "vy": 0.25, "rcs": 0.5}.items():
        off = 0.45 * step * rng.uniform(-1, 1, len(scan))
        columns[name] = columns[name] + off.astype(np.float32)
    columns["id"] = rng.integers(0, 256, len(scan)).astype(np.uint8)
    fields = ("x_rms", "y_rms", "vx_rms", "vy_rms", "pdh0", "ambig_state", "invalid_state")
    columns |= {field: rng.integers(0, 8, len(scan)).astype(np.uint8) for field in fields}
    return replace(scan, near=0, far=len(scan), meas_counter=9, sequence=77, **columns)


def test_order_ids_quality_and_what_the_bus_cannot_carry_tell_a_window_nothing(
    estimator: RadarEstimator, scans: tuple[RadarScan, ...]
) -> None:
    plain, other = estimator.follow(), estimator.follow()
    for index, scan in enumerate(scans):
        noisy = degraded(scan, "snr", 40.0, seed=1)
        expected = plain(noisy)
        answer = other(disguised(noisy, index))
        np.testing.assert_array_equal(answer.probabilities, expected.probabilities)
        assert answer.kind_probabilities == expected.kind_probabilities


def test_threads_that_share_an_estimator_answer_as_one_does(
    estimator: RadarEstimator, scans: tuple[RadarScan, ...]
) -> None:
    def answers(seed: int) -> NDArray[np.float64]:
        follow = estimator.follow()
        return np.array([follow(degraded(s, "snr", 50.0, seed)).probabilities for s in scans])

    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(answers, range(8)))
    np.testing.assert_array_equal(together, [answers(seed) for seed in range(8)])


def test_first_answer_is_that_of_the_scan_alone(
    estimator: RadarEstimator, scans: tuple[RadarScan, ...]
) -> None:
    np.testing.assert_array_equal(
        estimator.follow()(scans[0]).probabilities, estimator.estimate(scans[0]).probabilities
    )


def test_window_holds_the_last_scans_and_no_more(scans: tuple[RadarScan, ...]) -> None:
    whole, late = ScanWindow(), ScanWindow()
    for scan in scans:
        last = whole.add(scan)
    late.add(scans[-WINDOW - 1])
    for scan in scans[-WINDOW:]:
        newest = late.add(scan)
    assert last is not None
    assert newest is not None
    np.testing.assert_array_equal(last, newest)


@pytest.mark.parametrize("gap_s", [MAX_GAP_S + 0.1, 0.0, -5.0], ids=["long", "none", "back"])
def test_gap_starts_a_new_window(scans: tuple[RadarScan, ...], gap_s: float) -> None:
    window = ScanWindow()
    window.add(scans[0])
    after = replace(scans[1], stamp_ns=scans[0].stamp_ns + round(gap_s * 1e9))
    np.testing.assert_array_equal(window.add(after), ScanWindow().add(after))


@pytest.mark.parametrize("step", [1, 2])
@pytest.mark.parametrize("speed", [0.5, 2.0, 7.0])
def test_scans_whose_stamps_do_not_run_with_the_radars_counter_stand_alone(
    scans: tuple[RadarScan, ...], step: int, speed: float
) -> None:
    """A recording that is played slower or faster: what moves is not where it is expected."""
    window = ScanWindow()
    window.add(counting(scans[0], 0, step))
    for number, scan in enumerate(scans[1:6], start=1):
        since_ns = round((scan.stamp_ns - scans[0].stamp_ns) / speed)
        played = counting(scan, number, step)
        played = replace(played, stamp_ns=scans[0].stamp_ns + since_ns)
        np.testing.assert_array_equal(window.add(played), ScanWindow().add(played))


@pytest.mark.parametrize("step", [0, 1, 2])
@pytest.mark.parametrize("lost", [1, 3])
def test_scans_at_their_own_speed_go_on_however_the_counter_counts(
    scans: tuple[RadarScan, ...], step: int, lost: int
) -> None:
    """Whether it stands still or counts one or two a cycle, with all scans or some lost."""
    window, plain = ScanWindow(), ScanWindow()
    for number, scan in enumerate(scans[:9:lost]):
        plain.add(scan)
        window.add(counting(scan, number * lost, step))
    last = counting(scans[-1], len(scans) - 1, step)
    np.testing.assert_array_equal(window.add(last), plain.add(scans[-1]))


def test_recorded_scans_go_on(data: Path) -> None:
    """At 2 Hz, with the counter of a radar that went on measuring in between."""
    for drive in recorded_drives(data):
        window = ScanWindow()
        for number, scan in enumerate(drive.scans[:8]):
            seen = window.add(scan)
            assert seen is not None
            assert np.exp(seen[0, FOLLOWS + 1]) == pytest.approx(number + 1)


def counting(scan: RadarScan, number: int, step: int) -> RadarScan:
    """Return a scan whose counter has counted so often since 65535."""
    return replace(scan, meas_counter=(65535 + number * step) % 65536)


def test_empty_scan_holds_no_evidence_and_ends_the_window(scans: tuple[RadarScan, ...]) -> None:
    columns: dict[str, Any] = {name: values[:0] for name, values in scans[1].arrays().items()}
    window = ScanWindow()
    window.add(scans[0])
    assert window.add(replace(scans[1], near=0, far=0, **columns)) is None
    np.testing.assert_array_equal(window.add(scans[2]), ScanWindow().add(scans[2]))


@pytest.mark.parametrize("n", [1, 2, 125, 250])
@pytest.mark.parametrize("place", [0.2, 30.0, 250.0])
@pytest.mark.parametrize("rcs", [-64.0, 63.5])
def test_any_scans_in_a_row_are_finite(
    estimator: RadarEstimator, scans: tuple[RadarScan, ...], n: int, place: float, rcs: float
) -> None:
    """All clusters at one place: at the sensor's foot, and at its farthest."""
    follow = estimator.follow()
    for scan in scans[:3]:
        index = np.arange(n) % len(scan)
        columns: dict[str, Any] = {name: values[index] for name, values in scan.arrays().items()}
        columns |= {"x": np.full(n, place), "y": np.zeros(n), "rcs": np.full(n, rcs)}
        columns = {
            name: values.astype(np.float32) if values.dtype.kind == "f" else values
            for name, values in columns.items()
        }
        estimate = follow(replace(scan, near=n, far=0, **columns))
        assert np.all(np.isfinite(estimate.probabilities))
        assert estimate.probabilities.sum() == pytest.approx(1.0, abs=1e-12)
        assert 0.0 <= estimate.level <= 100.0
        assert 0.0 <= estimate.std <= 50.0


def test_what_stands_is_carried_to_where_it_is_found() -> None:
    """The median stationary echo of a turning, driving sensor is found within a few centimetres."""
    for seed in range(3):
        radar = WorldRadar(World(SEED + seed, 40.0))
        for stride in (1, 7):
            earlier, later = (view(radar.scan(cycle)) for cycle in (200, 200 + stride))
            there = carried(earlier, later)[:, earlier.still]
            apart = np.hypot(
                there[0][:, np.newaxis] - later.position[0],
                there[1][:, np.newaxis] - later.position[1],
            ).min(axis=1)
            assert np.median(apart) < 0.6


def test_share_of_echoes_that_come_back_to_their_place_falls_with_the_noise(
    scans: tuple[RadarScan, ...],
) -> None:
    back = []
    for level in (0.0, 30.0, 60.0, 100.0):
        views = [view(degraded(scan, "snr", level, seed=2)) for scan in scans]
        back.append(np.mean([pair_features(a, b)[:3].sum() for a, b in pairwise(views)]))
    assert back == sorted(back, reverse=True)
    assert back[0] > 3 * back[-1]


def test_jitter_alone_is_told_from_none_by_a_window_but_hardly_by_a_scan(
    estimator: RadarEstimator,
) -> None:
    clean = simulated_drive(SEED + 5, 100, WINDOW).scans
    calm, shaken = estimator.follow(), estimator.follow()
    for scan in clean:
        quiet = calm(scan)
        loud = shaken(degraded(scan, "jitter", 80.0, seed=1))
    assert quiet.level < 10.0
    assert loud.level > quiet.level + 25.0


def test_number_of_inputs(scans: tuple[RadarScan, ...]) -> None:
    first = evidence(scans[0], None)
    second = evidence(scans[1], first)
    assert inputs([first], 1).shape == (1, INPUTS)
    assert inputs([first, second], 2, 1).shape == (2, INPUTS)
    np.testing.assert_array_equal(first.row[-PAIR_FEATURES:], np.zeros(PAIR_FEATURES))
