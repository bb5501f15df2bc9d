"""Benchmarks of the radar in time: what restarts and left-out scans give and cost."""

from __future__ import annotations

import pytest

from models.estimate.radar import RadarEstimator
from models.estimate.radar_window import RECENT
from models.evaluate.radar import Drive, simulated_drive
from models.evaluate.radar_effort import effort_table
from models.evaluate.radar_step import NEWEST, step_results
from models.evaluate.report import Picture, Table


@pytest.fixture(scope="module")
def drives() -> list[Drive]:
    return [simulated_drive(2**31 + seed, 30, 64) for seed in (5000, 5001)]


def test_restarts_follow_a_step_sooner_and_cost_nothing_at_rest(drives: list[Drive]) -> None:
    newest, picture, run_times = step_results(RadarEstimator(), drives)
    assert isinstance(newest, Table)
    assert isinstance(picture, Picture)
    assert isinstance(run_times, Table)
    rest, second = ({row[0]: float(row[place]) for row in newest.rows} for place in (1, 2))
    assert len(rest) == len(NEWEST)
    assert rest[str(RECENT)] < rest["never starts anew"] + 1.0
    assert second[str(RECENT)] < second["never starts anew"] / 2
    assert all(0 < row[1] <= row[2] <= row[3] for row in run_times.rows)  # type: ignore[operator]


def test_adaptive_effort_looks_at_fewer_scans(drives: list[Drive]) -> None:
    table = effort_table(RadarEstimator(), drives)
    looked = {(row[0], row[1]): float(row[3]) for row in table.rows}
    assert {share for (_, effort), share in looked.items() if effort == "every scan"} == {100.0}
    assert all(45 < share < 90 for (_, effort), share in looked.items() if effort == "adaptive")
