"""What ``murk bench switch`` calls switching: the model that was chosen before the frame came."""

from __future__ import annotations

import numpy as np
import pytest

from models.bev.ospa import ospa
from node.bench.switch import CAMERA_ENDS_S, Drive, changing, constant, drive, replay


@pytest.fixture(scope="module")
def recorded() -> Drive:
    return drive(7_000_100, duration_s=2.0)


def test_a_clean_camera_answers_all_the_time(recorded: Drive) -> None:
    clean = replay(recorded, [])
    assert not clean.answered.any()
    np.testing.assert_array_equal(clean.switched, clean.errors[:, 0])
    assert (clean.levels < 5).all()


def test_a_dark_one_until_its_level_is_known(recorded: Drive) -> None:
    dark = replay(recorded, constant("under", 90))
    assert dark.answered[0] == 0
    assert dark.answered[2:].all()
    np.testing.assert_array_equal(dark.switched[2:], dark.errors[2:, 1])
    assert abs(dark.levels[2:] - 90).max() < 15


def test_noise_of_the_radar_does_not_change_what_the_camera_s_level_is(recorded: Drive) -> None:
    noisy = replay(recorded, constant("snr", 80))
    assert not noisy.answered.any()


def test_a_camera_that_ends_sees_nothing_and_is_replaced(recorded: Drive) -> None:
    ended = replay(recorded, [], camera_ends_s=0.5)
    late = ended.t_s >= 0.5
    blind = [ospa(np.empty((0, 2)), moment.truth) for moment in recorded.moments]
    np.testing.assert_array_equal(ended.errors[late, 0], np.array(blind)[late])
    assert ended.answered[-1] == 1
    assert np.isnan(ended.levels[late]).all()


def test_the_schedules_are_what_the_report_says() -> None:
    over, under = (one.schedule(0) for one in changing())
    assert [over.level_at(t) for t in (0.5, 2.0, 3.5)] == [0, 80, 0]
    assert [under.level_at(t) for t in (3.5, 5.0, 6.5)] == [0, 80, 0]
    assert 0 < CAMERA_ENDS_S < 8
