"""The gateway's CAN side without clock and bus: what comes in when, and what goes out when."""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.ars408_layout import CAN_ID, ID_SHIFT, Kind, shortest_payload
from drivers.can_frames import CanFrames, FrameFlag, concatenate
from drivers.encode import encode_scan
from drivers.scan import RadarScan
from models.sensor import ARS408
from node.gateway_frames import Outbox, TimedFrames
from node.gateway_levels import GatewayLevels
from node.gateway_scan import LONGEST_SCAN_NS, IncomingScan, Kinds
from node.gateway_stream import STREAMED_KINDS, ScanStream
from node.interference import states_of, with_interference_told
from node.link_faults import FULL_LOAD_SPACING_NS, LinkFaults
from node.scene import Sensor

log = logging.getLogger("murk.gateway")

_LISTS = (Kind.CLUSTER_STATUS, Kind.CLUSTER_GENERAL, Kind.CLUSTER_QUALITY)
"""The frames of a cluster scan; every other one is of kind 0."""
_STATUS = int(Kind.CLUSTER_STATUS)
_NOT_PLAIN = int(FrameFlag.EXTENDED | FrameFlag.REMOTE | FrameFlag.ERROR | FrameFlag.FD)

CATCH_UP_SPACING_NS = FULL_LOAD_SPACING_NS // 2
"""From frame to frame at least, where a scan has to wait for the end of the one before it."""


class CanGateway:
    """Lets the frames of a bus pass and changes the cluster scans of one radar.

    A frame that is not of the radar's cluster lists (0x600, 0x701, 0x702 + 0x10 × SensorID) passes
    at once. While no injection and no fault is in force, so does every other one. Otherwise a scan
    is kept back until it is complete, degraded, encoded anew and sent, its frames as far apart as
    they came: it leaves as much later as it took to come, which is less than a cycle. A scan that
    stays incomplete is sent as it came. A change of levels takes effect with the next scan.

    With low latency each cluster is changed and sent when it comes, by what the scan before taught
    (see ``node.gateway_stream``). A scan is stored nevertheless where there is no scan before it,
    or where a fault or a kind is in force that needs all of it.

    Parameters
    ----------
    sensor:
        The radar.
    levels:
        What is in force when.
    seed:
        The run's seed.
    low_latency:
        Whether to send each cluster when it comes.

    Attributes
    ----------
    counts:
        Scans: ``scans`` that came, of them ``degraded`` and ``incomplete`` ones, and ``failures``
        to degrade one, which was sent as it came. Frames that did not pass: ``silenced`` on a dead
        wire, ``cut_off`` from a scan that the end left half, ``late`` ones that came after their
        scan had been changed.
    faults:
        The link's faults, with their counts.
    """

    def __init__(
        self, sensor: Sensor, levels: GatewayLevels, seed: int, *, low_latency: bool = False
    ) -> None:
        self.counts: Counter[str] = Counter()
        self.faults = LinkFaults(sensor.name, seed)
        self._sensor = sensor
        self._levels = levels
        self._low_latency = low_latency
        self._before: RadarScan | None = None
        self._kind_of_id = np.zeros(0x800, np.uint8)
        for kind in _LISTS:
            self._kind_of_id[CAN_ID[kind] + ID_SHIFT * sensor.sensor_id] = kind
        self._shortest = shortest_payload()
        self._outbox = Outbox()
        self._scan: IncomingScan | None = None
        self._quality: bool | None = None
        self._first_ns: int | None = None
        self._last_due_ns = 0
        self._silent_until_ns = 0
        self._finishing = False

    def feed(self, frames: CanFrames, now_ns: int) -> None:
        """Take in frames that have come."""
        states = states_of(frames, self._sensor.sensor_id)
        if len(states) and self._levels.injector.take_burst() is not None:
            frames = with_interference_told(frames, states[:1].tolist())
        kinds = self._kind_of_id.take(frames.can_id, mode="clip")
        kinds[(frames.flags & _NOT_PLAIN != 0) | (frames.length < self._shortest[kinds])] = 0
        statuses = np.flatnonzero(kinds == _STATUS).tolist()
        for first, last in pairwise(sorted({0, *statuses, len(frames)})):
            part = frames if last - first == len(frames) else frames.select(slice(first, last))
            if kinds[first] == _STATUS:
                self._begin(part.data[0], now_ns)
            self._go_on(part, kinds[first:last], now_ns)

    def due(self, now_ns: int) -> CanFrames | None:
        """Return what is to be sent now; None where nothing is."""
        expires_ns = self._expires_ns()
        if self._scan is not None and expires_ns is not None and expires_ns <= now_ns:
            self._end(self._scan, now_ns)
        return self._outbox.take(now_ns)

    def next_due_ns(self) -> int | None:
        """Return when ``due`` will have something to do if nothing comes; None for never."""
        times = (self._outbox.next_due_ns, self._expires_ns())
        return min((time for time in times if time is not None), default=None)

    def finish(self) -> None:
        """Begin no further scan; what is on its way out goes on to its end."""
        self._finishing = True
        scan = self._scan
        if scan is None or scan.over:
            return
        if scan.held:
            scan.over = True
            self.counts["cut_off"] += sum(map(len, scan.frames))
        else:
            self._end_if_whole(scan, scan.begun_ns)

    @property
    def finished(self) -> bool:
        """Whether nothing is on its way out."""
        return self._outbox.next_due_ns is None and (self._scan is None or self._scan.over)

    def _begin(self, status: NDArray[np.uint8], now_ns: int) -> None:
        if self._scan is not None and not self._scan.over:
            self._end(self._scan, now_ns)
        if self._first_ns is None:
            self._first_ns = now_ns
        t_s = self._since_first_s(now_ns)
        scan = IncomingScan(self.counts["scans"], now_ns, int(status[0]) + int(status[1]))
        scan.over = self._finishing
        scan.stream = self._stream(status, scan, t_s)
        scan.held = self._finishing or (scan.stream is None and self._levels.any_at(t_s))
        self._scan = scan
        self.counts["scans"] += 1
        if not scan.held:
            self.faults.clear()
            self._silent_until_ns = 0

    def _stream(
        self, status: NDArray[np.uint8], scan: IncomingScan, t_s: float
    ) -> ScanStream | None:
        """Return what changes a scan while it comes; None where it is to be stored or to pass."""
        if not self._low_latency or self._finishing or self._before is None:
            return None
        levels = self._levels.injector.levels_at(t_s)
        if not levels or self._levels.rates_at(t_s) or not set(levels) <= set(STREAMED_KINDS):
            return None
        if scan.announced > ARS408.max_clusters:
            return None
        injector = self._levels.injector
        drawn = [injector.draw(kind, level, scan.number) for kind, level in levels.items()]
        if any(one.quality != "frozen" for one in drawn):
            return None
        self.counts["degraded"] += 1
        return ScanStream(status, self._before, drawn)

    def _go_on(self, frames: CanFrames, kinds: Kinds, now_ns: int) -> None:
        """Take in frames up to the next status frame."""
        scan, own = self._scan, kinds > 0
        passes = scan is None or not (scan.held or scan.stream)
        if passes:
            self._forward(frames, own, now_ns)
        if not own.all():
            if not passes:
                self._pass(frames.select(~own), now_ns)
            frames, kinds = frames.select(own), kinds[own]
        if scan is None or not len(frames):
            return
        if scan.stream is not None:
            self._send_next(scan.stream.feed(frames, kinds), now_ns)
        if not scan.over:
            scan.add(frames, kinds, now_ns)
            if scan.held or self._finishing:
                self._end_if_whole(scan, now_ns)
        elif scan.held:
            self.counts["cut_off" if self._finishing else "late"] += len(frames)

    def _pass(self, frames: CanFrames, now_ns: int) -> None:
        """Send frames at once, unless the wire is dead."""
        if now_ns < self._silent_until_ns:
            self.counts["silenced"] += len(frames)
        else:
            self._outbox.put(TimedFrames(frames, np.full(len(frames), now_ns)))

    def _forward(self, frames: CanFrames, own: NDArray[np.bool_], now_ns: int) -> None:
        """Send frames at once; but the radar's follow those that still wait."""
        if self._last_due_ns <= now_ns or not own.any():
            self._pass(frames, now_ns)
        else:
            self._pass(frames.select(~own), now_ns)
            self._send_next(frames.select(own), now_ns)

    def _send_next(self, frames: CanFrames, now_ns: int) -> None:
        """Send frames of the radar at once, but behind those that still wait."""
        if len(frames):
            due_ns = np.full(len(frames), now_ns)
            self._outbox.put(self._behind(TimedFrames(frames, due_ns), now_ns))

    def _behind(self, timed: TimedFrames, now_ns: int) -> TimedFrames:
        """Return the radar's frames no earlier than now, and than those that still wait let them.

        Where they have to wait they follow each other faster, until they are in time again.
        """
        due_ns = timed.due_ns
        before_ns = max(self._last_due_ns, now_ns - CATCH_UP_SPACING_NS)
        if before_ns > due_ns[0]:
            steps = np.arange(1, len(timed) + 1) * CATCH_UP_SPACING_NS
            due_ns = np.maximum(due_ns, before_ns + steps)
        self._last_due_ns = int(due_ns[-1])
        return TimedFrames(timed.frames, due_ns)

    def _expires_ns(self) -> int | None:
        scan = self._scan
        if scan is None or scan.over or not (scan.held or self._finishing):
            return None
        return scan.expires_ns(quality=self._quality)

    def _end_if_whole(self, scan: IncomingScan, now_ns: int) -> None:
        if scan.is_overfull or scan.is_whole(quality=self._quality is not False):
            self._end(scan, now_ns, min(now_ns, scan.begun_ns + scan.took_ns))

    def _end(self, scan: IncomingScan, now_ns: int, since_ns: int | None = None) -> None:
        """Expect no more of the scan; send what became of it where it was kept back.

        Parameters
        ----------
        since_ns:
            When it was whole, by its stamps: earlier than now where nobody read at that time.
        """
        scan.over = True
        if scan.has_quality is not None:
            self._quality = scan.has_quality
        if self._low_latency:
            self._before = scan.clusters(self._sensor)
        if not scan.held:
            return
        t_s = self._since_first_s(scan.begun_ns)
        frames, offset_ns = _spaced(*self._changed(scan, t_s))
        begin_ns = now_ns if since_ns is None else since_ns
        timed = self._behind(TimedFrames(frames, begin_ns + offset_ns), now_ns)
        rates = self._levels.rates_at(t_s)
        sent = self.faults.apply(timed, rates, scan.number)
        self._silent_until_ns = now_ns + LONGEST_SCAN_NS if self.faults.silent else 0
        self.counts["silenced"] += len(timed) if self.faults.silent else 0
        self._outbox.put(sent)
        self._outbox.put(self.faults.babble(timed, rates, scan.number))
        self._last_due_ns = max([self._last_due_ns, *sent.due_ns[-1:].tolist()])

    def _changed(self, scan: IncomingScan, t_s: float) -> tuple[CanFrames, CanFrames]:
        """Return what came of a scan, and what is to be sent instead."""
        came = concatenate(scan.frames)
        decoded = scan.clusters(self._sensor)
        if decoded is None:
            self.counts["incomplete"] += 1
            return came, came
        try:
            degraded, injected = self._levels.injector.inject(decoded, t_s)
            frames = encode_scan(degraded) if injected else came
        except Exception:
            self.counts["failures"] += 1
            if self.counts["failures"] == 1:
                log.exception("a scan of %s failed; more are counted", self._sensor.name)
            return came, came
        if not injected:
            return came, came
        self.counts["degraded"] += 1
        frames.data[0, 2:5] = came.data[0, 2:5]  # counter and interface version
        return came, frames

    def _since_first_s(self, now_ns: int) -> float:
        return 0.0 if self._first_ns is None else (now_ns - self._first_ns) * 1e-9


def _spaced(came: CanFrames, frames: CanFrames) -> tuple[CanFrames, NDArray[np.int64]]:
    """Return frames with the stamps of those that came, and when each follows the first, ns.

    The k-th is as far from the first as the k-th that came. Where there are more than came, they
    share the time that those took.
    """
    passed_ns = np.maximum.accumulate(came.stamp_ns) - came.stamp_ns[0]
    passed_ns = np.minimum(passed_ns, LONGEST_SCAN_NS)
    if len(frames) <= len(came):
        passed_ns = passed_ns[: len(frames)]
    else:
        places = np.linspace(0, len(came) - 1, len(frames))
        passed_ns = np.interp(places, np.arange(len(came)), passed_ns).astype(np.int64)
    return replace(frames, stamp_ns=came.stamp_ns[0] + passed_ns), passed_ns
