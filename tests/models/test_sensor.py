from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.sensor import ARS408


def test_the_accuracies_are_those_of_the_data_sheet():
    azimuths = np.radians([0, 45, -60, 80])
    assert np.degrees(ARS408.azimuth_std(10.0, azimuths)) == pytest.approx([0.3, 1, 5, 5])
    assert np.degrees(ARS408.azimuth_std(10.0, np.radians(52.5))) == pytest.approx(3)
    assert np.degrees(ARS408.azimuth_std(100.0, azimuths)) == pytest.approx(0.1)
    assert ARS408.range_std([69.9, 70.0]) == pytest.approx([0.10, 0.40])
    assert ARS408.range_resolution([10, 200]) == pytest.approx([0.39, 1.79])
    assert np.degrees(ARS408.azimuth_resolution([10, 200], 0.0)) == pytest.approx([3.2, 1.6])
    assert ARS408.velocity_std * 3.6 == pytest.approx(0.1)


def test_the_fields_of_view_are_those_of_the_data_sheet():
    ranges = np.array([0.1, 19.0, 21.0, 99.0, 101.0])
    straight, oblique = np.zeros(5), np.full(5, np.radians(59.9))
    assert ARS408.sees_near(ranges, straight).tolist() == [False, True, True, True, False]
    assert ARS408.sees_near(ranges, oblique).tolist() == [False, True, False, False, False]
    assert not ARS408.sees_near(10.0, np.radians(61))
    assert ARS408.sees_far([249.0, 251.0], 0.0).tolist() == [True, False]
    assert not ARS408.sees_far(200.0, np.radians(9.1))


def test_ghost_bands_narrow_with_range():
    reaches = (0.2, 9.9, 10.0, 99.9, 100.0, 1e6)
    widths = np.degrees([ARS408.ghost_azimuth(reach) for reach in reaches])
    assert widths == pytest.approx([60, 60, 40, 40, 9, 9])


@given(
    st.sampled_from(ARS408.grid),
    st.floats(allow_nan=False, allow_infinity=False, width=64, min_value=-1e9, max_value=1e9),
)
def test_the_grid_is_nearest_and_idempotent(field, value):
    on_grid = float(ARS408.to_grid(field.name, value))
    lowest, highest = field.offset, field.offset + field.step * (field.count - 1)
    assert lowest <= on_grid <= highest + 1e-9
    if lowest <= value <= highest:
        assert abs(on_grid - value) <= field.step / 2 + 1e-9
    assert float(ARS408.to_grid(field.name, np.float32(on_grid))) == on_grid


def test_rows_and_fields_agree():
    rows = np.random.default_rng(3).normal(0, 50, (5, 100))
    together = ARS408.rows_to_grid(rows)
    for row, field in enumerate(ARS408.grid):
        np.testing.assert_array_equal(together[row], ARS408.to_grid(field.name, rows[row]))
