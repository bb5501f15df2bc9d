from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drivers.hardware_clock import HardwareClock


@given(
    st.integers(-(10**18), 10**18),
    st.lists(st.integers(0, 5_000_000), min_size=1, max_size=200),
    st.floats(-50e-6, 50e-6),
)
def test_stamps_are_never_later_than_the_systems_nor_earlier_than_the_least_delay_allows(
    offset_ns: int, delays_ns: list[int], drift: float
) -> None:
    """Frames every 10 ms, each batch one frame, a device's clock that drifts."""
    clock = HardwareClock()
    truth_ns = 10_000_000 * np.arange(len(delays_ns)) + 10**18
    hardware_ns = truth_ns + offset_ns + (drift * (truth_ns - 10**18)).astype(np.int64)
    software_ns = truth_ns + np.array(delays_ns)
    told_ns = [
        int(clock.to_system(hardware_ns[k : k + 1], software_ns[k : k + 1])[0])
        for k in range(len(truth_ns))
    ]
    late_ns = np.array(told_ns) - truth_ns
    assert (np.array(told_ns) <= software_ns).all()
    least_so_far_ns = np.minimum.accumulate(delays_ns)
    slack_ns = 150e-6 * (truth_ns - truth_ns[0]) + 1_000
    assert (late_ns <= least_so_far_ns + slack_ns).all()
    assert (late_ns >= min(delays_ns) - 1_000 - slack_ns).all()


def test_spacing_of_the_device_is_kept_within_a_batch() -> None:
    hardware_ns = np.array([100, 250, 400])
    told_ns = HardwareClock().to_system(hardware_ns, np.array([10_100, 19_999, 11_400]))
    assert np.diff(told_ns).tolist() == [150, 150]
    assert told_ns[0] == 10_100


def test_a_clock_that_is_set_is_followed_at_once() -> None:
    clock = HardwareClock()
    clock.to_system(np.array([0]), np.array([1_000]))
    hour_ns = 3_600 * 10**9
    assert clock.to_system(np.array([10**9]), np.array([10**9 + hour_ns])) == 10**9 + hour_ns
