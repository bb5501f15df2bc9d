from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.estimate.smooth import KindFilter, agreeing

weights = st.lists(st.floats(0.0, 1.0), min_size=5, max_size=5).filter(lambda row: sum(row) > 0.1)
KINDS = ("clean", "snr", "ghosts", "missed", "jitter")


@given(weights, st.floats(0.0, 1.0))
def test_clean_is_level_0_and_the_others_keep_their_proportions(
    row: list[float], level_0: float
) -> None:
    kinds = dict(zip(KINDS, (weight / sum(row) for weight in row), strict=True))
    agreed = agreeing(kinds, level_0)
    assert agreed["clean"] == level_0
    assert sum(agreed.values()) == pytest.approx(1.0)
    crossed = agreed["snr"] * kinds["jitter"], agreed["jitter"] * kinds["snr"]
    assert crossed[0] == pytest.approx(crossed[1], abs=1e-6)


@given(weights, st.integers(0, 10**10))
def test_the_average_sums_to_one_and_goes_to_what_lasts(row: list[float], step_ns: int) -> None:
    first = dict(zip(KINDS, (weight / sum(row) for weight in row), strict=True))
    lasting = dict.fromkeys(KINDS, 0.0) | {"snr": 1.0}
    average = KindFilter(0.3)
    average.update(0, first)
    assert sum(average.update(step_ns, lasting).values()) == pytest.approx(1.0)
    assert average.update(step_ns + 10**10, lasting)["snr"] == pytest.approx(1.0, abs=1e-6)


def test_a_late_measurement_has_no_weight() -> None:
    average = KindFilter(0.3)
    average.update(10**9, {"clean": 1.0, "snr": 0.0})
    assert average.update(0, {"clean": 0.0, "snr": 1.0}) == {"clean": 1.0, "snr": 0.0}
