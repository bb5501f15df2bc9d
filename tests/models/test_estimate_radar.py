"""The radar estimator: blind to what may betray an injection, sane on any scan."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc.errors import InputError, ModelError
from drivers.scan import RadarScan
from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.estimate.radar import RadarEstimator
from models.evaluate.radar import (
    degraded,
    joined,
    measure,
    measure_together,
    radar_filter,
    recorded_drives,
    simulated_drive,
    step_response,
)
from models.evaluate.radar_extremes import extremes

SEED = 2**31 + 1000  # of worlds that no training draws


def make_scan(n: int, rng: np.random.Generator | None = None, **columns: np.ndarray) -> RadarScan:
    rng = rng or np.random.default_rng(0)
    values = {
        "x": rng.uniform(2, 100, n),
        "y": rng.uniform(-40, 40, n),
        "vx": rng.uniform(-20, 5, n),
        "vy": rng.uniform(-3, 3, n),
        "rcs": rng.uniform(-5, 30, n),
    } | columns
    return RadarScan(
        sensor="radar",
        sensor_id=0,
        sequence=0,
        stamp_ns=0,
        stamp_source="simulated",
        mode="cluster",
        meas_counter=0,
        near=n,
        far=0,
        id=np.arange(n, dtype=np.uint8),
        dyn_prop=rng.integers(0, 8, n).astype(np.uint8),
        **{name: np.asarray(value, np.float32) for name, value in values.items()},
    )


def reordered(scan: RadarScan, order: np.ndarray) -> RadarScan:
    return replace(scan, **{name: values[order] for name, values in scan.arrays().items()})


def assert_sane(estimate: Estimate) -> None:
    assert estimate.probabilities.shape == (11,)
    assert np.all(estimate.probabilities >= 0.0)
    assert estimate.probabilities.sum() == pytest.approx(1.0, abs=1e-12)
    assert 0.0 <= estimate.level <= 100.0
    assert 0.0 <= estimate.std <= 50.0
    assert tuple(estimate.kind_probabilities) == RADAR_KINDS
    assert sum(estimate.kind_probabilities.values()) == pytest.approx(1.0)


@pytest.fixture(scope="module")
def estimator() -> RadarEstimator:
    return RadarEstimator()


@pytest.fixture(scope="module")
def scan() -> RadarScan:
    clean = simulated_drive(SEED, 40, 1).scans[0]
    return degraded(clean, "snr", 50.0, seed=3)


def test_order_ids_and_quality_tell_it_nothing(estimator: RadarEstimator, scan: RadarScan) -> None:
    rng = np.random.default_rng(1)
    shuffled = reordered(scan, rng.permutation(len(scan)))
    fields = ("x_rms", "y_rms", "vx_rms", "vy_rms", "pdh0", "ambig_state", "invalid_state")
    disguised = replace(
        shuffled,
        id=rng.integers(0, 256, len(scan)).astype(np.uint8),
        near=0,
        far=len(scan),
        meas_counter=999,
        sequence=77,
        **{field: rng.integers(0, 8, len(scan)).astype(np.uint8) for field in fields},
    )
    bare = replace(shuffled, **dict.fromkeys(fields))
    expected = estimator.estimate(scan)
    for other in (shuffled, disguised, bare):
        answer = estimator.estimate(other)
        np.testing.assert_array_equal(answer.probabilities, expected.probabilities)
        assert answer.kind_probabilities == expected.kind_probabilities


def test_values_off_the_bus_grid_tell_it_nothing(
    estimator: RadarEstimator, scan: RadarScan
) -> None:
    rng = np.random.default_rng(2)
    steps = {"x": 0.2, "y": 0.2, "vx": 0.25, "vy": 0.25, "rcs": 0.5}
    off_grid = replace(
        scan,
        **{
            name: getattr(scan, name)
            + (0.45 * step * rng.uniform(-1, 1, len(scan))).astype(np.float32)
            for name, step in steps.items()
        },
    )
    np.testing.assert_array_equal(
        estimator.estimate(off_grid).probabilities, estimator.estimate(scan).probabilities
    )


@pytest.mark.parametrize("n", [1, 2, 3, 125, 250])
def test_any_number_of_clusters(estimator: RadarEstimator, n: int) -> None:
    assert_sane(estimator.estimate(make_scan(n)))


def test_no_clusters_no_opinion(estimator: RadarEstimator) -> None:
    estimate = estimator.estimate(make_scan(0))
    assert_sane(estimate)
    np.testing.assert_allclose(estimate.probabilities, 1 / 11)
    np.testing.assert_allclose(list(estimate.kind_probabilities.values()), 1 / len(RADAR_KINDS))


def test_one_cluster_hardly_any_opinion(estimator: RadarEstimator) -> None:
    assert estimator.estimate(make_scan(1)).std > 20.0


@pytest.mark.parametrize(
    "columns",
    [
        {"x": np.full(50, 0.2), "y": np.zeros(50)},
        {"x": np.zeros(50), "y": np.zeros(50)},
        {"x": np.full(50, 250.0)},
        {"rcs": np.full(50, 63.5)},
        {"rcs": np.full(50, -64.0)},
        {"vx": np.full(50, 127.75), "vy": np.full(50, -64.0)},
        {"x": np.full(50, 1e30), "vx": np.full(50, -1e30)},
        {"x": np.full(50, np.nan), "rcs": np.full(50, np.inf)},
    ],
    ids=["at 0.2 m", "at the sensor", "250 m", "strong", "weak", "fast", "huge", "not finite"],
)
def test_extreme_scans(estimator: RadarEstimator, columns: dict[str, np.ndarray]) -> None:
    assert_sane(estimator.estimate(make_scan(50, **columns)))


@pytest.mark.parametrize("name", extremes())
def test_what_no_radar_should_send_is_answered_with_doubt(
    estimator: RadarEstimator, name: str
) -> None:
    estimate = estimator.estimate(extremes()[name])
    assert_sane(estimate)
    assert estimate.std > 5


@settings(max_examples=50, deadline=None)
@given(n=st.integers(1, 250), seed=st.integers(0, 2**32), power=st.floats(-3, 6))
def test_never_fails_and_never_sees_the_order(n: int, seed: int, power: float) -> None:
    rng = np.random.default_rng(seed)
    columns = {name: 10**power * rng.standard_normal(n) for name in ("x", "y", "vx", "vy", "rcs")}
    scan = make_scan(n, rng, **columns)
    estimator = RadarEstimator()
    estimate = estimator.estimate(scan)
    assert_sane(estimate)
    other = estimator.estimate(reordered(scan, rng.permutation(n)))
    np.testing.assert_array_equal(other.probabilities, estimate.probabilities)


def test_object_mode_is_refused_with_a_remedy(estimator: RadarEstimator) -> None:
    with pytest.raises(InputError, match="cluster mode"):
        estimator.estimate(replace(make_scan(5), mode="object"))


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError):
        RadarEstimator(tmp_path / "missing.onnx")
    with pytest.raises(ModelError, match="camera"):
        RadarEstimator(Path(__file__).parents[2] / "models" / "weights" / "camera.onnx")


def test_simulated_second_reads_low_when_clean_and_high_when_degraded(
    estimator: RadarEstimator,
) -> None:
    drives = [simulated_drive(SEED + index, 50, 14) for index in range(4)]
    answers = measure_together(estimator.follow, drives, radar_filter, scans=14, draws=1)
    means = [answers.among(answers.levels == level).probabilities @ LEVELS for level in LEVELS]
    assert np.mean(means[0]) < 25.0
    assert np.mean(means[6]) > 45.0
    assert np.mean(means[10]) > 75.0


def test_step_is_followed(estimator: RadarEstimator) -> None:
    drives = [simulated_drive(SEED + index, 50, 84) for index in range(2)]
    levels = step_response(estimator.follow, drives, radar_filter, level=60.0)
    assert levels[:, 28:42].mean() < 25.0
    assert abs(levels[:, -14:].mean() - 60.0) < 25.0


def test_better_than_chance_on_recorded_drives(data: Path, estimator: RadarEstimator) -> None:
    """These drives are in the training; the card has the honest figures."""
    drives = [replace(drive, scans=drive.scans[::20]) for drive in recorded_drives(data)]
    figures = measure(estimator.estimate, drives, draws=1).figures()
    assert figures["accuracy"] > 0.2
    assert figures["mean_error"] < 18.0


def test_kinds_are_told_apart_better_than_by_chance(estimator: RadarEstimator) -> None:
    drives = [simulated_drive(SEED + index, 20, 2) for index in range(10)]
    answers = joined(
        [measure(estimator.estimate, drives, draws=1, kind=kind) for kind in RADAR_KINDS[1:]]
    )
    shares = answers.kind_confusion() / answers.kind_confusion().sum(axis=1, keepdims=True)
    assert np.diag(shares).mean() > 0.3
