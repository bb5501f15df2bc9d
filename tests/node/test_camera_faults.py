from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest

from drivers.frame import Frame
from node.camera_faults import CAMERA_FAULTS, LONGEST_DELAY_NS, CameraFaults


def frame(sequence: int, height: int = 12) -> Frame:
    image = np.full((height, 8, 3), 1 + sequence % 250, np.uint8)
    return Frame(image, "camera", sequence, sequence * 40_000_000, "simulated")


def images(fault: str, rate: float, count: int) -> tuple[CameraFaults, list[int | None]]:
    """Return the value of the first pixel of each frame that came out, None where none came."""
    faults = CameraFaults("camera", 1)
    out = []
    for sequence in range(count):
        after, _ = faults.apply(frame(sequence), {fault: rate})
        out.append(None if after is None else int(after.image[0, 0, 0]))
    return faults, out


@pytest.mark.parametrize("fault", CAMERA_FAULTS)
def test_the_rate_holds_and_zero_is_the_identity(fault: str) -> None:
    faults, _ = images(fault, 30, 2000)
    interval = binomtest(faults.counts[fault], 2000).proportion_ci(0.999)
    assert interval.low <= 0.3 <= interval.high
    none = CameraFaults("camera", 1)
    after, late_ns = none.apply(frame(4), {fault: 0})
    assert after is not None
    assert late_ns == 0
    np.testing.assert_array_equal(after.image, frame(4).image)


@pytest.mark.parametrize("fault", CAMERA_FAULTS)
def test_the_seed_repeats_a_fault(fault: str) -> None:
    def run(seed: int) -> list[tuple[bytes, int]]:
        faults = CameraFaults("camera", seed)
        results = [faults.apply(frame(k), {fault: 40}) for k in range(30)]
        return [(after.image.tobytes() if after else b"", late) for after, late in results]

    assert run(1) == run(1) != run(2)


def test_a_frozen_camera_repeats_its_picture_under_new_stamps() -> None:
    faults = CameraFaults("camera", 1)
    faults.apply(frame(0), {})
    for sequence in (1, 2):
        after, _ = faults.apply(frame(sequence), {"frozen": 100})
        assert after is not None
        np.testing.assert_array_equal(after.image, frame(0).image)
        assert after.stamp_ns == frame(sequence).stamp_ns
    thawed, _ = faults.apply(frame(3), {})
    assert thawed is not None
    np.testing.assert_array_equal(thawed.image, frame(3).image)


def test_black_and_dropped_frames() -> None:
    faults, black = images("black", 50, 40)
    assert black.count(0) == faults.counts["black"] > 0
    faults, dropped = images("dropped", 50, 40)
    assert dropped.count(None) == faults.counts["dropped"] > 0
    assert all(value in (None, 1 + k) for k, value in enumerate(dropped))


def test_a_torn_frame_is_the_new_one_above_and_the_last_one_below() -> None:
    faults = CameraFaults("camera", 1)
    faults.apply(frame(0), {})
    after, _ = faults.apply(frame(1), {"torn": 100})
    assert after is not None
    rows = after.image[:, 0, 0].tolist()
    assert rows == sorted(rows, reverse=True)
    assert set(rows) == {1, 2}


def test_late_frames_come_up_to_the_limit_late() -> None:
    faults = CameraFaults("camera", 1)
    late = [faults.apply(frame(k), {"late": 100})[1] for k in range(200)]
    assert 0 < min(late) < LONGEST_DELAY_NS / 10
    assert LONGEST_DELAY_NS * 0.9 < max(late) <= LONGEST_DELAY_NS


def test_a_change_of_size_tears_and_freezes_nothing() -> None:
    faults = CameraFaults("camera", 1)
    faults.apply(frame(0), {})
    after, _ = faults.apply(frame(1, height=20), {"torn": 100, "frozen": 100})
    assert after is not None
    np.testing.assert_array_equal(after.image, frame(1, height=20).image)
