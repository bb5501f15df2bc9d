"""CAN frames to radar scans: the ARS 408-21's cluster and object lists put together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from drivers.ars408_bulk import RadarFrames
from drivers.ars408_layout import (
    PAYLOAD_BYTES,
    RMS_METRES,
    SENSOR_IDS,
    Kind,
    kind_table,
    sensor_can_ids,
    shortest_payload,
)
from drivers.ars408_radar import Item, Placed, Radar
from drivers.can_frames import CanFrames, FrameFlag

__all__ = ["RMS_METRES", "Item", "ScanAssembler", "sensor_can_ids"]

_KIND_BITS, _SENSOR_SHIFT = np.uint8(0x0F), np.uint8(4)
"""What ``kind_table`` packs into a byte."""
_FOREIGN = int(FrameFlag.EXTENDED | FrameFlag.REMOTE | FrameFlag.ERROR | FrameFlag.FD)


class ScanAssembler:
    """Puts the frames of all radars on one bus together into scans.

    A scan is given out with the last frame that its status frame announced; it never waits for the
    next status frame to show that it was the last. Whether quality (0x702, 0x60C) and extended
    (0x60D) lists will come is not announced. It is known

    - from the radar's own state (0x201: SendQuality, SendExtInfo) as soon as one was seen,
    - else from the cycles before: a list that was seen is expected, until three general
      lists in a row came whole without it.

    The first scan of a sensor, before either is known, stays open until a radar state or the next
    status frame settles it. So if quality is switched on and no state says so, one scan goes
    without (its quality frames are strays); if it is switched off and no state says so,
    three scans come a cycle late, with their quality frames counted as lost.

    A scan that is incomplete when the next status frame comes is given out and marked. Clusters
    whose general frame was lost are missing from it; fields whose quality or extended frame was
    lost hold ``drivers.ars408_layout.NO_VALUE``. A field of a list of which no frame came is None.

    A status frame that is repeated before any other frame of its cycle is a duplicate. Frames that
    are shorter than their message are strays. Extended, remote, error and CAN FD frames are
    ignored.

    The step of MeasCounter is the smallest change that came twice in a row; until then no cycle
    counts as lost. A gap of over 1000 cycles that does not fit into the time between the stamps is
    a radar that restarted: none is lost either.

    Regular cycles are found and decoded many at a time (``drivers.ars408_bulk``), all others one
    by one (``drivers.ars408_radar``); how a stream is cut into batches changes nothing of what
    comes out.

    Parameters
    ----------
    sensors:
        Name by SensorID; other radars are ignored. None: every radar, named ``radar_<SensorID>``.
    """

    def __init__(self, sensors: Mapping[int, str] | None = None) -> None:
        names = {n: f"radar_{n}" for n in SENSOR_IDS} if sensors is None else sensors
        self._radars = {sensor_id: Radar(sensor_id, name) for sensor_id, name in names.items()}
        self._codes = kind_table(list(names))
        self._shortest = shortest_payload()

    @property
    def strays(self) -> int:
        """Stray frames that no scan has counted so far."""
        return sum(radar.strays for radar in self._radars.values())

    @property
    def missing(self) -> int:
        """How many frames, as far as is known, the next scan still lacks; 0 between two scans."""
        open_scans = [radar.missing for radar in self._radars.values() if radar.missing]
        return min(open_scans, default=0)

    def feed(self, frames: CanFrames) -> list[Item]:
        """Take frames in order of reception; return what they complete, in the same order."""
        codes = self._codes.take(frames.can_id, mode="clip")  # the last ID is no radar's
        if frames.flags.any():
            codes[frames.flags & _FOREIGN != 0] = 0
        if codes.all():
            rows = np.arange(len(frames))
        else:
            rows = np.flatnonzero(codes)
            codes, frames = codes[rows], frames.select(rows)
        if not len(frames):
            return []
        kinds: NDArray[np.uint8] = codes & _KIND_BITS
        is_brief = frames.length < PAYLOAD_BYTES
        if is_brief.any():
            kinds[is_brief & (frames.length < self._shortest[kinds])] = Kind.TOO_SHORT
        payload = frames.data[:, :PAYLOAD_BYTES]
        received = RadarFrames(rows, kinds, payload, frames.stamp_ns, frames.stamp_source)
        found: list[Placed] = []
        for radar, its_frames in self._by_radar(codes >> _SENSOR_SHIFT, received):
            found += radar.feed(its_frames, frames.dropped)
        found.sort(key=itemgetter(0))
        return [item for _, item in found]

    def _by_radar(
        self, sensor_ids: NDArray[np.uint8], frames: RadarFrames
    ) -> Iterator[tuple[Radar, RadarFrames]]:
        """Yield each radar that sent some of the frames, and those."""
        if len(self._radars) == 1:
            yield from ((radar, frames) for radar in self._radars.values())
            return
        for sensor_id in np.unique(sensor_ids).tolist():
            own = sensor_ids == sensor_id
            yield (
                self._radars[sensor_id],
                frames if own.all() else frames.take(np.flatnonzero(own)),
            )

    def flush(self) -> list[Item]:
        """Return the scans that are still open, by stamp: the stream has ended."""
        scans = [scan for radar in self._radars.values() for scan in radar.flush()]
        return sorted(scans, key=lambda scan: scan.stamp_ns)
