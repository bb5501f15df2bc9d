"""What one scan tells if something of the clean scan is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from models.estimate.level import LEVELS
from models.evaluate.radar import Answers, Drive, simulated_drive

pytest.importorskip("sklearn")

from models.training.radar_told import (
    told_count_and_threshold,
    told_neighbours,
    told_nothing,
)


@pytest.mark.parametrize("told", [told_nothing, told_neighbours, told_count_and_threshold])
def test_every_scan_is_answered_by_what_other_drives_taught(
    told: Callable[..., Answers],
) -> None:
    drives = [simulated_drive(2**31 + 3100 + k, 20, 3) for k in range(2)]
    answers = told(drives, seed=0)
    assert answers.drives.tolist() == sorted(answers.drives.tolist())
    assert np.bincount(answers.drives).tolist() == [3 * 4 * len(LEVELS)] * 2
    np.testing.assert_allclose(answers.probabilities.sum(axis=1), 1.0)


def test_a_drive_teaches_nothing_about_itself() -> None:
    """The last scan of a drive is no neighbour of its first: its answers do not depend on it."""
    drives = [simulated_drive(2**31 + 3100 + k, 20, 4) for k in range(2)]
    short = Drive("short", drives[0].scans[:3])
    first = 4 * len(LEVELS)
    whole, cut = (told_neighbours([each, drives[1]], seed=0) for each in (drives[0], short))
    np.testing.assert_array_equal(whole.probabilities[:first], cut.probabilities[:first])
