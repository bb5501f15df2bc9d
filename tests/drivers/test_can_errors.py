from __future__ import annotations

import numpy as np
import pytest

from drivers.can_errors import bus_states
from drivers.can_frames import CanFrames, FrameFlag


def frame(can_id: int, controller: int, flags: int = FrameFlag.ERROR) -> CanFrames:
    data = np.zeros((1, 8), np.uint8)
    data[0, 1] = controller
    return CanFrames(
        stamp_ns=np.zeros(1, np.int64),
        can_id=np.array([can_id], np.uint32),
        length=np.array([8], np.uint8),
        data=data,
        flags=np.array([flags], np.uint8),
        channel=np.zeros(1, np.uint8),
    )


@pytest.mark.parametrize(
    ("can_id", "controller", "expected"),
    [
        (0x040, 0, ["bus-off"]),
        (0x004, 0x10, ["error passive"]),
        (0x004, 0x20, ["error passive"]),
        (0x004, 0x08, ["error warning"]),
        (0x004, 0x40, ["error active"]),
        (0x100, 0, ["error active"]),
        (0x002, 0x30, []),
    ],
)
def test_the_controllers_state_is_read(can_id: int, controller: int, expected: list[str]) -> None:
    assert bus_states(frame(can_id, controller)) == expected


def test_data_frames_say_nothing_of_the_controller() -> None:
    assert bus_states(frame(0x040, 0x10, flags=0)) == []
