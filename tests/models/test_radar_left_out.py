"""What was reached on drives left out: written, read back and shown as it was measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.estimate.network import WEIGHTS
from models.evaluate.radar import Answers, gather, simulated_drive
from models.evaluate.radar_learned import learned_from
from models.evaluate.radar_left_out import Learned, LeftOut, LeftOutAnswers, OneDrive
from models.evaluate.radar_recorded import errors_table, levels_table, recorded_results
from models.evaluate.report import Goal, Picture, Table


def answers(kind: str, off: int) -> Answers:
    """Return answers to every level, each taken for one so many levels higher, and twice for it."""
    kinds = {each: float(each == kind) for each in RADAR_KINDS}
    rows = []
    for place, level in enumerate(LEVELS):
        higher = Estimate(np.eye(11)[min(place + off, 10)], kinds)
        rows += [
            (0, kind, float(level), each) for each in (higher, Estimate(np.eye(11)[place], kinds))
        ]
    return gather(rows)


@pytest.fixture
def left_out() -> LeftOut:
    kinds = {kind: answers(kind, number % 3) for number, kind in enumerate(RADAR_KINDS[1:], 1)}
    bounds = [answers("snr", 0), answers("snr", 1)]
    reached = LeftOutAnswers.of(kinds, bounds)
    drive = simulated_drive(3, 100, 3)
    told = (kinds["snr"], bounds[1], bounds[1], bounds[0], bounds[0])
    every = OneDrive.of("all", drive.scans, *told)
    moves = np.array([True])
    learned = [
        Learned.of(0, False, [kinds["snr"]], moves),
        Learned.of(1, False, [kinds["snr"], bounds[0]], moves),
        Learned.of(2, False, [bounds[0]], moves),
        Learned.of(2, True, [bounds[0]], moves),
    ]
    return LeftOut(reached, reached, [every], learned, {"with restart": [1.0, 2.0, 40.0, 3.0]})


def test_it_says_what_was_answered(left_out: LeftOut) -> None:
    scan = left_out.scan
    assert scan.count == 22
    assert scan.accuracy == pytest.approx(12 / 22, abs=1e-4)
    assert scan.mean_error == pytest.approx(10 * 10 / 22, abs=1e-3)
    assert scan.calibration_error == pytest.approx(10 / 22, abs=1e-4)
    assert scan.bounds[0] == [1.0, 0.0]
    assert scan.levels["missed"] == LEVELS.tolist()
    assert scan.levels["snr"][:2] == [5.0, 15.0]
    assert np.trace(scan.kind_confusion) == 20 * (len(RADAR_KINDS) - 1)
    assert scan.kinds["snr"]["accuracy"] == scan.accuracy


def test_it_is_read_as_it_was_written(left_out: LeftOut, tmp_path: Path) -> None:
    left_out.write(tmp_path / "radar.json")
    assert LeftOut.read(tmp_path / "radar.json") == left_out


def test_goals_and_tables_show_it(left_out: LeftOut) -> None:
    results = list(recorded_results(left_out))
    goals = {each.name: each for each in results if isinstance(each, Goal)}
    assert goals["radar, one recorded scan, right, %"].value == pytest.approx(54.55, abs=0.01)
    assert goals["radar, one recorded scan, right, %"].met
    assert not goals["radar, seven recorded scans, right, %"].met
    tables = {each.title: each for each in results if isinstance(each, Table)}
    confusion = tables["Radar: seven recorded scans, confusion, %"].rows
    assert confusion[0][:3] == ("0", "50", "50")
    steps = tables["Radar: recorded drives at 2 Hz, error after a step of 60 points, by scan"]
    assert steps.rows == (("with restart", 1.5, "40", "3"),)
    (every,) = tables["Radar: one recorded scan by drive, and what is missing"].rows
    assert every[2:] == (*("54.5 % / 4.5",) * 3, *("100.0 % / 0.0",) * 2)
    assert float(every[1]) > 1.0
    (clean,) = tables[
        "Radar: how clean scans of a drive differ, and what a loss takes of them"
    ].rows
    assert 0.0 < float(clean[4]) < float(clean[5]) < float(clean[2])
    assert sum(isinstance(each, Picture) for each in results) == 3


def test_learned_is_the_mean_over_choices_of_drives(left_out: LeftOut) -> None:
    none, one, two, half = left_out.learned
    assert none.spread == [0.0, 0.0]
    assert one.reached == pytest.approx([(12 / 22 + 1) / 2, 100 / 44], abs=1e-3)
    assert one.spread == pytest.approx([(1 - 12 / 22) / 2, 100 / 44], abs=1e-3)
    assert one.moving == one.reached
    assert one.standing == [0.0, 0.0]
    tables = [each for each in recorded_results(left_out) if isinstance(each, Table)]
    (table,) = (each for each in tables if "learned from" in each.title)
    assert [row[0] for row in table.rows] == [learned_from(x) for x in (none, one, two, half)]
    assert table.rows[-1][1] == 100.0
    (doublings,) = (each for each in tables if "would take" in each.title)
    name, slope, reached, goal, missing = doublings.rows[0]
    assert name == "right, %"
    assert (slope, reached) == pytest.approx((100 * (1 - one.reached[0]), 100.0))
    assert missing == pytest.approx((40.0 - 100 * one.reached[0]) / float(slope))
    assert goal == 40.0


def test_levels_that_are_right_are_0_apart() -> None:
    table = levels_table("any", {"snr": LEVELS.tolist(), "ghosts": [50.0] * 11})
    assert table.rows[0][-1] == 0.0
    assert table.rows[1][-1] == pytest.approx(np.abs(LEVELS - 50).mean())


def test_an_answer_that_is_wide_enough_has_the_truth_within_it() -> None:
    right = np.eye(11)
    wide = Estimate(np.full(11, 1 / 11), dict.fromkeys(RADAR_KINDS, 1 / len(RADAR_KINDS)))
    far = Estimate(right[10], wide.kind_probabilities)
    near = Estimate(right[3], wide.kind_probabilities)
    answers = gather([(0, "missed", 30.0, each) for each in (wide, far, near)])
    (row,) = errors_table("any", {"missed": answers.figures()}).rows
    assert row[:2] == ("missed", 3)
    assert row[2:] == pytest.approx((100 / 3, 30.0, np.sqrt(1000) / 3, 200 / 3))


def test_what_ships_holds_every_kind_and_meets_the_goals_of_seven_scans() -> None:
    shipped = LeftOut.read(WEIGHTS / "radar.json")
    for each in (shipped.scan, shipped.window):
        assert set(each.levels) == set(RADAR_KINDS[1:])
        assert len(each.kind_confusion) == len(RADAR_KINDS)
        assert each.calibration_error <= 0.05
    assert [each.name for each in shipped.drives[-1:]] == ["all"]
    assert shipped.drives[-1].reached == [shipped.scan.accuracy, shipped.scan.mean_error]
    goals = [each for each in recorded_results(shipped) if isinstance(each, Goal)]
    assert all(goal.met for goal in goals if "seven" in goal.name)
