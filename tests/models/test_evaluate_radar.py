"""Figures of an evaluation, from answers whose figures are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dbc.errors import InputError
from drivers.scan import RadarScan
from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.evaluate.radar import (
    Drive,
    joined,
    measure,
    measure_together,
    radar_filter,
    recorded_drives,
    simulated_drive,
    step_response,
)

KINDS = dict.fromkeys(RADAR_KINDS, 0.2)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return simulated_drive(7, 10, 6)


def always(level: int) -> Estimate:
    return Estimate(probabilities=np.eye(11)[level], kind_probabilities=KINDS)


def test_an_estimator_that_always_says_30(drive: Drive) -> None:
    answers = measure(lambda scan: always(3), [drive], draws=2)
    figures = answers.figures()
    assert figures["count"] == 6 * 11 * 2
    assert figures["accuracy"] == pytest.approx(1 / 11)
    assert figures["mean_error"] == pytest.approx(np.abs(LEVELS - 30).mean())
    np.testing.assert_array_equal(answers.confusion()[:, 3], np.full(11, 12))
    assert answers.confusion().sum() == 6 * 11 * 2


def test_level_0_is_the_clean_scan_itself_and_of_kind_clean(drive: Drive) -> None:
    seen: list[RadarScan] = []

    def watch(scan: RadarScan) -> Estimate:
        seen.append(scan)
        return always(0)

    answers = measure(watch, [drive], draws=1, kind="jitter")
    assert seen[0] is drive.scans[0]
    assert seen[10] is not drive.scans[0]
    assert np.all((answers.kinds == RADAR_KINDS.index("clean")) == (answers.levels == 0))


def test_log_loss_of_no_opinion_is_that_of_eleven_levels(drive: Drive) -> None:
    nothing = Estimate(probabilities=np.full(11, 1 / 11), kind_probabilities=KINDS)
    figures = measure(lambda scan: nothing, [drive], draws=1).figures()
    assert figures["log_loss"] == pytest.approx(np.log(11))


def test_several_scans_together_are_surer(drive: Drive) -> None:
    hint = Estimate(probabilities=np.where(np.arange(11) == 4, 2, 1) / 12, kind_probabilities=KINDS)
    single = measure(lambda scan: hint, [drive], draws=1)
    together = measure_together(lambda: lambda scan: hint, [drive], radar_filter, scans=6, draws=1)
    assert len(together.levels) == 11
    assert together.probabilities[:, 4].min() > single.probabilities[:, 4].max()


def test_step_is_in_the_middle(drive: Drive) -> None:
    clean = {id(scan) for scan in drive.scans}
    levels = step_response(
        lambda: lambda scan: always(0 if id(scan) in clean else 9),
        [drive],
        radar_filter,
        level=90.0,
    )
    np.testing.assert_allclose(levels, [[0, 0, 0, 90, 90, 90]], atol=0.2)


def test_joined_answers_keep_their_drive(drive: Drive) -> None:
    answers = [measure(lambda scan, k=k: always(k), [drive], draws=1) for k in (0, 10)]
    both = joined(answers)
    assert both.by_drive()[0] == answers[0].figures()
    assert both.by_drive()[1] == answers[1].figures()


def test_recorded_drives(data: Path) -> None:
    drives = recorded_drives(data)
    assert len(drives) == 7
    for drive in drives:
        stamps = [scan.stamp_ns for scan in drive.scans]
        assert stamps == sorted(stamps)
        assert all(0 < len(scan) <= 125 for scan in drive.scans)


def test_missing_or_foreign_data_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no recorded drives"):
        recorded_drives(tmp_path)
    folder = tmp_path / "radar" / "nuscenes_mini"
    folder.mkdir(parents=True)
    np.savez(folder / "scene.npz", other=np.zeros(3))
    with pytest.raises(InputError, match="no recorded drive"):
        recorded_drives(tmp_path)


def test_scans_are_not_changed_by_measuring(drive: Drive) -> None:
    before = [replace(scan, x=scan.x.copy()) for scan in drive.scans]
    measure(lambda scan: always(0), [drive], draws=1)
    for scan, copy in zip(drive.scans, before, strict=True):
        np.testing.assert_array_equal(scan.x, copy.x)
