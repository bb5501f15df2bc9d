"""Small candump logs that tests play."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drivers.can_frames import CanFrames
from drivers.candump import write_candump

START_NS = 1_532_402_927_664_178_000


def frames_at(stamps_ns: list[int], can_ids: list[int] | None = None, flags: int = 0) -> CanFrames:
    count = len(stamps_ns)
    return CanFrames(
        stamp_ns=np.array(stamps_ns, np.int64),
        can_id=np.array(can_ids or [0x701] * count, np.uint32),
        length=np.full(count, 8, np.uint8),
        data=(np.arange(count, dtype=np.int64)[:, None] >> (8 * np.arange(8))).astype(np.uint8),
        flags=np.full(count, flags, np.uint8),
        channel=np.zeros(count, np.uint8),
    )


def write(path: Path, *batches: CanFrames) -> Path:
    write_candump(path, batches)
    return path
