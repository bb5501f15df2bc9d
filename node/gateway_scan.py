"""One cluster scan as it comes into the gateway, frame by frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.ars408 import ScanAssembler
from drivers.ars408_layout import Kind
from drivers.can_frames import CanFrames, concatenate
from drivers.scan import RadarScan
from models.sensor import ARS408
from node.gateway_stream import ScanStream
from node.scene import Sensor

Kinds = NDArray[np.uint8]
"""``Kind`` of each frame."""

LONGEST_SCAN_NS = 2 * round(ARS408.cycle_s * 1e9)
"""When nothing of a scan has come for two cycles, what it lacks does not come any more."""
QUALITY_WAIT_NS = 20_000_000
"""How long the first scan waits for its quality frames before it counts as one without."""
MOST_FRAMES = 4096
"""No scan has as many frames."""

_GENERAL, _QUALITY = int(Kind.CLUSTER_GENERAL), int(Kind.CLUSTER_QUALITY)


class IncomingScan:
    """One cluster scan as it comes in.

    Parameters
    ----------
    number:
        Counted from the start.
    begun_ns:
        When its status frame came.
    announced:
        How many clusters that announces.

    Attributes
    ----------
    held:
        Whether it is kept back to be changed.
    stream:
        Changes it cluster by cluster; where it is None and the scan is not held, that passes as
        over a wire.
    over:
        Whether nothing more is expected of it; what comes to a held one nevertheless is too late.
    frames, count:
        What has come of it, and how many frames that are.
    """

    def __init__(self, number: int, begun_ns: int, announced: int) -> None:
        self.number = number
        self.begun_ns = begun_ns
        self.held = False
        self.stream: ScanStream | None = None
        self.over = False
        self.frames: list[CanFrames] = []
        self.count = 0
        self.announced = announced
        self._came = np.zeros((len(Kind), 256), np.bool_)
        self._last_ns = begun_ns
        self._listed_ns: int | None = None

    def add(self, frames: CanFrames, kinds: Kinds, now_ns: int) -> None:
        """Take in frames of this scan."""
        self._last_ns = now_ns
        self._came[kinds, frames.data[:, 0]] = True
        if not self.is_overfull:
            self.frames.append(frames)
        self.count += len(frames)
        if self._listed_ns is None and self._count(_GENERAL) >= self.announced:
            self._listed_ns = now_ns

    @property
    def is_overfull(self) -> bool:
        """Whether so many frames have come that it is no scan."""
        return self.count > MOST_FRAMES

    @property
    def took_ns(self) -> int:
        """How long its frames took to come, by their stamps."""
        took_ns = int(self.frames[-1].stamp_ns[-1] - self.frames[0].stamp_ns[0])
        return min(max(took_ns, 0), LONGEST_SCAN_NS)

    @property
    def has_quality(self) -> bool | None:
        """Whether quality frames come with the clusters; None where that cannot be told."""
        if not self.announced or self._listed_ns is None:
            return None
        return self._count(_QUALITY) > 0

    def is_whole(self, *, quality: bool) -> bool:
        """Tell whether nothing is missing; ``quality`` says whether quality frames count."""
        if self._listed_ns is None:
            return False
        return not quality or self._count(_QUALITY) >= self.announced

    def expires_ns(self, *, quality: bool | None) -> int:
        """Return when to wait no longer; ``quality`` says whether quality frames are expected."""
        if quality is None and self._listed_ns is not None and not self.has_quality:
            return self._listed_ns + QUALITY_WAIT_NS
        return self._last_ns + LONGEST_SCAN_NS

    def clusters(self, sensor: Sensor) -> RadarScan | None:
        """Return what came as clusters; None where the scan is incomplete."""
        if self.is_overfull or not self.is_whole(quality=self.has_quality is True):
            return None
        assembler = ScanAssembler({sensor.sensor_id: sensor.name})
        items = [*assembler.feed(concatenate(self.frames)), *assembler.flush()]
        scan = next(item for item in items if isinstance(item, RadarScan))
        return None if scan.frames_lost else replace(scan, sequence=self.number)

    def _count(self, kind: int) -> int:
        return int(np.count_nonzero(self._came[kind]))
