"""Training of the radar's network: it runs, repeats itself, and keeps drives apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.scan import RadarScan
from models.estimate.level import LEVELS, RADAR_KINDS
from models.estimate.radar import RadarEstimator
from models.estimate.radar_features import FEATURES
from models.estimate.radar_view import EgoMotion, ego_motion
from models.estimate.radar_window import INPUTS, VERSION, extent
from models.evaluate.radar import simulated_drive
from models.evaluate.radar_left_out import LeftOut
from models.training.radar_scans import SIMULATED, Amounts, join, make_samples

SMALL = Amounts(repeats=2, joined=6, worlds=1, sparse=5)


def test_quick_training_writes_a_network_that_loads_and_its_card(
    data: Path, tmp_path: Path
) -> None:
    pytest.importorskip("torch")
    pytest.importorskip("sklearn")
    from models.training.radar import train

    reports: list[dict[str, object]] = []
    summary = train(data, tmp_path / "radar.onnx", quick=True, seed=1, report=reports.append)
    assert [report.get("fold") for report in reports if "fold" in report] == [1, 2]
    estimate = RadarEstimator(tmp_path / "radar.onnx").estimate(simulated_drive(3, 5, 1).scans[0])
    assert estimate.probabilities.sum() == pytest.approx(1.0)
    card = (tmp_path / "radar.md").read_text()
    assert "CC BY-NC-SA 4.0" in card
    assert f"{summary['parameters']:,} parameters" in card
    figures = summary["recorded_scan"]
    assert isinstance(figures, dict)
    assert f"| one recorded scan | {figures['count']:,} | {figures['accuracy']:.1%} |" in card
    left_out = LeftOut.read(tmp_path / "radar.json")
    for answers, name in (
        (left_out.scan, "recorded_scan"),
        (left_out.window, "recorded_seven_scans"),
    ):
        reached = summary[name]
        assert isinstance(reached, dict)
        assert answers.count == reached["count"] == np.sum(answers.confusion)
        assert answers.accuracy == pytest.approx(reached["accuracy"], abs=1e-3)
        assert answers.mean_error == pytest.approx(reached["mean_error"], abs=1e-3)
        assert sum(answers.reliability[0]) == answers.count
        assert set(answers.levels) == set(RADAR_KINDS[1:])
        assert all(0.0 <= level <= 100.0 for row in answers.levels.values() for level in row)


def test_onnx_equals_pytorch(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    from models.training.export import export
    from models.training.radar import Perceptron, RadarNet

    torch.manual_seed(0)
    alone, follows = (Perceptron(torch.zeros(n), torch.ones(n)) for n in (FEATURES, INPUTS))
    network = RadarNet(alone, follows).eval()
    path = tmp_path / "radar.onnx"
    example = {"window": torch.zeros(2, INPUTS)}
    export(network, example, path, model="radar", version=VERSION, kinds=RADAR_KINDS)
    written, living = RadarEstimator(path).follow(), RadarEstimator(network).follow()
    for scan in simulated_drive(3, 5, 5).scans:
        np.testing.assert_allclose(
            written(scan).probabilities, living(scan).probabilities, atol=1e-5
        )


def test_temperature_sharpens_what_is_too_wide_and_leaves_the_order() -> None:
    torch = pytest.importorskip("torch")
    from models.training.radar import fit
    from models.training.radar_temperature import temper

    drives = [simulated_drive(seed, 10, 2) for seed in (1, 2)]
    held_out = make_samples(drives, replace(SMALL, joined=0, sparse=0, steps=0), seed=5)
    network = fit(make_samples(drives, SMALL, seed=4), 0)
    window = torch.from_numpy(held_out.inputs)
    before, _ = network(window)
    surprises = []
    for scale in (1.0, 0.1):  # of the logits
        for perceptron in (network.alone, network.follows):
            perceptron.layers[-1].weight.data[: len(LEVELS)] *= scale
            perceptron.layers[-1].bias.data[: len(LEVELS)] *= scale
        temper(network, {0: network, 1: network}, held_out)
        after, _ = network(window)
        levels = torch.from_numpy(held_out.levels)
        surprises.append(float(torch.nn.functional.cross_entropy(after.detach(), levels)))
        np.testing.assert_array_equal(after.argmax(dim=1), before.argmax(dim=1))
    assert surprises[1] == pytest.approx(surprises[0], rel=0.02)


def test_temperature_rises_where_dense_scans_look_like_a_kind_without_a_level() -> None:
    torch = pytest.importorskip("torch")
    from models.training.radar_temperature import Temperature

    temperature = Temperature()
    kinds = torch.eye(len(RADAR_KINDS)) * 20  # logits, each certain of one
    dense, sparse = (
        temperature(torch.tensor([extent(round(13 * spacing_s * 1e9), 14)]), kinds).detach()[:, 0]
        for spacing_s in (0.072, 0.5)
    )
    np.testing.assert_allclose(sparse, 1.0)
    doubted = [kind for kind, value in zip(RADAR_KINDS, dense, strict=True) if value > 2.0]
    assert doubted == [kind for kind in RADAR_KINDS if kind not in ("clean", "snr", "jitter")]
    assert sum(dense == 1.0) == len(RADAR_KINDS) - len(doubted)


def test_samples_repeat_and_leave_a_drive_out_completely() -> None:
    drives = [simulated_drive(seed, 10, 2) for seed in (1, 2, 3)]
    samples = make_samples(drives, SMALL, seed=4)
    again = make_samples(drives, SMALL, seed=4)
    np.testing.assert_array_equal(samples.inputs, again.inputs)
    courses, steps = len(LEVELS) + len(RADAR_KINDS) - 2, 2
    single, recorded, simulated = (6 + 5) * courses, 2 * 3 * (2 + 1), (14 + 13) + 8
    assert len(samples.levels) == single + (recorded + simulated) * (courses + steps)
    assert set(samples.kinds) == set(range(len(RADAR_KINDS)))
    assert np.bincount(samples.levels, minlength=11).min() >= 6
    rest = samples.without(1)
    assert 1 in samples.drives
    assert 1 not in rest.drives
    assert SIMULATED in rest.drives


def test_joined_scan_moves_as_one() -> None:
    """Two halves with different ego motions: all stationary points agree with one motion."""
    left = simulated_drive(1, 10, 1).scans[0]
    right = simulated_drive(2, 30, 1).scans[0]
    right = replace(right, vx=right.vx - 5, vy=right.vy + np.float32(0.25) * np.rint(right.x / 5))
    ours, theirs = motion_of(left), motion_of(right)
    assert abs(ours.ahead - theirs.ahead) > 3.0
    for seed in range(5):
        both = join(left, right, np.random.default_rng(seed))
        assert len(both) <= 125
        assert motion_of(both).ahead == pytest.approx(ours.ahead, abs=0.2)
        assert abs(motion_of(both).turn) == pytest.approx(abs(ours.turn), abs=0.01)


def motion_of(scan: RadarScan) -> EgoMotion:
    position, velocity = np.array([scan.x, scan.y], float), np.array([scan.vx, scan.vy], float)
    return ego_motion(position, velocity, scan.dyn_prop)
