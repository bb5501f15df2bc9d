"""Opponents of the radar's network: they train, are measured as it is, and are shown beside it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sklearn")

import torch

from dbc.errors import InputError
from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.estimate.network import WEIGHTS
from models.evaluate.opponents import Opponent, read_opponents
from models.evaluate.radar import gather, simulated_drive
from models.evaluate.radar_left_out import LeftOut
from models.evaluate.radar_rivals import RECORDED_UNIT, UNIT, opponents_table, rival_points
from models.evaluate.report import on_front
from models.training.radar_opponents import OPPONENTS, train_opponent
from models.training.radar_paper import PaperNetwork, raw_columns


def test_the_papers_network_has_the_papers_size_and_looks_at_each_scan_alone() -> None:
    network = PaperNetwork(torch.zeros(18), torch.ones(18))
    assert sum(weights.numel() for weights in network.parameters()) == 21_739
    scans = simulated_drive(2**31 + 3000, 40, 2).scans
    clusters = [torch.from_numpy(raw_columns(scan)) for scan in scans]
    both, second = network(clusters), network(clusters[1:])
    np.testing.assert_allclose(
        both[1].detach().numpy(), second[0].detach().numpy(), rtol=1e-4, atol=1e-5
    )


@pytest.mark.parametrize(
    ("name", "windows"),
    [("regressor", False), ("trees", False), ("paper", False), ("trained_on_simulated", True)],
)
def test_an_opponent_is_measured_as_the_network_is(
    data: Path, tmp_path: Path, name: str, windows: bool
) -> None:
    output = tmp_path / f"radar_{name}.json"
    train_opponent(name, data, output, quick=True, seed=0, report=lambda _: None)
    tables = Opponent(**json.loads(output.read_text())).tables
    assert tables["recorded_scan"]["all"]["count"] == 2 * 7 * len(LEVELS)
    assert tables["simulated_scan"]["all"]["count"] == 28 * len(LEVELS)
    assert ("simulated_second" in tables) == windows
    assert ("recorded_seven_scans" in tables) == windows


def test_unknown_opponent(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="regressor"):
        train_opponent(
            "x", tmp_path, tmp_path / "o.json", quick=True, seed=0, report=lambda _: None
        )


def test_shipped_opponents_are_known_and_worse_than_the_network() -> None:
    reached = LeftOut.read(WEIGHTS / "radar.json")
    shipped = {one.name: one.tables for one in read_opponents("radar")}
    assert set(shipped) == set(OPPONENTS)
    for name in ("regressor", "paper", "trained_on_recorded", "trained_on_simulated"):
        assert shipped[name]["recorded_scan"]["all"]["accuracy"] < reached.scan.accuracy


def test_the_network_is_on_the_front_among_its_opponents() -> None:
    """With any error below the opponents', for their run times are written beside its own."""
    kinds = dict.fromkeys(RADAR_KINDS, 1 / len(RADAR_KINDS))
    right = gather(
        [(0, "snr", float(level), Estimate(np.eye(11)[k], kinds)) for k, level in enumerate(LEVELS)]
    )
    answers, left_out = {1: right, 14: right}, LeftOut.read(WEIGHTS / "radar.json")
    points = list(rival_points(answers, {1: 100.0, 14: 200.0}, left_out))
    for unit in (UNIT, RECORDED_UNIT):
        own = [point for point in points if point.unit == unit]
        assert [point.knob for point in own if point.shipped] == [
            "window=14" if unit == UNIT else "seven scans"
        ]
        assert len(own) == 2 + len(OPPONENTS)
    best = [point.variant for point, front in zip(points, on_front(points), strict=True) if front]
    assert set(best) == {"radar network"}
    table = opponents_table(answers, left_out)
    assert [row[0] for row in table.rows[-2:]] == ["paper, as it reports", "murk"]
    assert table.rows[-1][-1] == "100.0 % / 0.0"
