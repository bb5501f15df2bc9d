"""The best test with the clean scan in hand."""

from __future__ import annotations

import numpy as np
import pytest

from models.estimate.level import LEVELS
from models.evaluate.radar import Drive, degraded, simulated_drive
from models.evaluate.radar_bound import log_likelihood, with_clean_scan

SEED = 2**31 + 3000


@pytest.fixture(scope="module")
def drives() -> list[Drive]:
    return [simulated_drive(SEED + k, 40, 2) for k in range(3)]


def test_untouched_scan_is_clean(drives: list[Drive]) -> None:
    scan = drives[0].scans[0]
    assert log_likelihood(scan, scan, moves=True).argmax() == 0
    assert log_likelihood(scan, scan, moves=False).argmax() == 0


@pytest.mark.parametrize("level", [30.0, 60.0, 100.0])
def test_true_level_is_among_the_likeliest(drives: list[Drive], level: float) -> None:
    for drive in drives:
        scan = drive.scans[0]
        log = log_likelihood(scan, degraded(scan, "snr", level, seed=1), moves=True)
        assert np.isfinite(log).all()
        assert abs(LEVELS[log.argmax()] - level) <= 10.0


def test_moves_tell_more_than_losses_and_two_scans_more_than_one(drives: list[Drive]) -> None:
    def error(scans: int, *, moves: bool) -> float:
        answers = with_clean_scan(drives, scans=scans, draws=1, moves=moves)
        return answers.figures()["mean_error"]

    gone, moved = error(1, moves=False), error(1, moves=True)
    assert moved < 2.0 < gone < 15.0
    assert error(2, moves=False) < gone
