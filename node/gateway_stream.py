"""A scan degraded cluster by cluster while it comes, by what the scan before it taught.

The status frame has to announce how many clusters follow before any of them has come. So the
number of missed clusters of each list is foretold: the share that the scan before would have
missed, under its own detection threshold and with the same random numbers. That number is kept to.
While it is not used up, a cluster whose echo falls under the threshold of the scan before is left
out; the last clusters of a list are left out, or spared, where it would not come out otherwise.

Ghosts are those that the scan before would have got. Each stands in its list where its range puts
it; the clusters themselves stay in the order in which they came, so that jitter may swap
neighbours in range. IDs count from 0, and a quality frame takes the new ID of its cluster.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dbc.codec import MessageCodec, ars408
from drivers.ars408_layout import CAN_ID, Kind
from drivers.can_frames import CanFrames
from drivers.encode import encode_scan
from drivers.scan import RadarScan
from models.degrade import radar
from models.degrade.clusters import Clusters
from models.degrade.radar import RadarDegradation
from models.sensor import ARS408

STREAMED_KINDS = radar.KINDS
"""Kinds that change each cluster for itself; every other one needs the whole scan."""

_STATUS, _GENERAL = int(Kind.CLUSTER_STATUS), int(Kind.CLUSTER_GENERAL)
_IDS = 256
_DONE = _IDS
_SIGNALS = ("DistLong", "DistLat", "VrelLong", "VrelLat", "RCS")

Payload = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class _Ghost:
    """A ghost's range, m, and its payloads; ``quality`` is None where the radar sends none."""

    range_m: float
    general: Payload
    quality: Payload | None


class ScanStream:
    """One scan on its way.

    Parameters
    ----------
    status:
        (8 or more,) uint8, payload of its status frame, which announces what a cycle can carry.
    before:
        The scan before it, as it came.
    drawn:
        What is in force, in order.
    """

    def __init__(
        self, status: Payload, before: RadarScan, drawn: Sequence[RadarDegradation]
    ) -> None:
        self._drawn = drawn
        self._deviates = [
            np.random.Generator(np.random.SFC64(one.seed)).standard_normal((4, _IDS))
            for one in drawn
        ]
        self._threshold_db = radar.threshold_db(_echoes_db(_rows(before)))
        sizes = [int(size) for size in status[:2]]
        self._ends = (sizes[0], sum(sizes))
        self._to_miss = self._foretold(before, sizes)
        self._ghosts = _ghosts_of(before, drawn) if sum(sizes) else (deque(), deque())
        limit = ARS408.max_clusters if before.pdh0 is None else ARS408.max_clusters_with_quality
        self._make_room(sizes, limit)
        self._new_id = np.full(_IDS, -1)
        """New ID by old one: -1 before it has come, ``_DONE`` where nothing more of it is sent."""
        self._next_id = 0
        self._qualities_left = sum(sizes) - sum(self._to_miss)
        self._ghost_qualities: deque[Payload] = deque()
        self._status = status[:8].copy()
        for part in (0, 1):
            self._status[part] = sizes[part] - self._to_miss[part] + len(self._ghosts[part])

    def feed(self, frames: CanFrames, kinds: NDArray[np.uint8]) -> CanFrames:
        """Return what is sent in place of the scan's frames; nothing for a cluster's second one.

        Parameters
        ----------
        kinds:
            (N,) ``Kind`` of each frame.
        """
        sent: list[tuple[Payload, int]] = []
        general = np.flatnonzero(kinds == _GENERAL)
        payloads = frames.data[:, :8].copy()
        missed = np.zeros(len(frames), np.bool_)
        missed[general], payloads[general] = self._changed(payloads[general])
        for row, kind in enumerate(kinds.tolist()):
            if kind == _STATUS:
                new = [self._status]
            elif kind == _GENERAL:
                new = self._general(payloads[row], bool(missed[row]))
            else:
                new = self._quality(payloads[row])
            sent += [(payload, row) for payload in new]
        if not sent:
            return frames.select(slice(0, 0))
        sent_payloads, causes = zip(*sent, strict=True)
        data = np.zeros((len(sent), frames.data.shape[1]), np.uint8)
        data[:, :8] = sent_payloads
        return replace(frames.select(np.array(causes)), data=data)

    def _changed(self, payloads: Payload) -> tuple[NDArray[np.bool_], Payload]:
        """Return which clusters fall under the threshold, and all as they were measured."""
        ids = payloads[:, 0]
        columns = _codec().decode(payloads)
        rows = np.array([columns[f"Cluster_{signal}"] for signal in _SIGNALS])
        missed = self._missed(rows, ids)
        scattered = rows
        for one, deviates in zip(self._drawn, self._deviates, strict=True):
            if one.kind in ("snr", "jitter"):
                clusters = Clusters(_scan_of(scattered), ARS408)
                radar.jitter(clusters, radar.std_growth(one.drop_db), deviates[1:, ids])
                scattered = clusters.rows
        if scattered is rows:
            return missed, payloads
        on_grid = ARS408.rows_to_grid(scattered)
        columns |= {f"Cluster_{name}": row for name, row in zip(_SIGNALS, on_grid, strict=True)}
        return missed, _codec().encode(columns)

    def _missed(self, rows: NDArray[np.float64], ids: NDArray[np.uint8]) -> NDArray[np.bool_]:
        margin_db = _echoes_db(rows) - self._threshold_db
        missed = np.zeros(len(ids), np.bool_)
        for one, deviates in zip(self._drawn, self._deviates, strict=True):
            if one.kind in ("snr", "missed"):
                missed |= radar.is_missed(margin_db, one.level, one.drop_db, deviates[0, ids])
        return missed

    def _foretold(self, before: RadarScan, sizes: list[int]) -> list[int]:
        """Return how many clusters of each list are to be missed."""
        missed = self._missed(_rows(before), np.arange(len(before), dtype=np.uint8))
        lists = (missed[: before.near], missed[before.near :])
        return [
            round(float(part.mean()) * size) if len(part) else 0
            for part, size in zip(lists, sizes, strict=True)
        ]

    def _make_room(self, sizes: list[int], limit: int) -> None:
        """Miss as many clusters more as ghosts would make the scan longer than a cycle carries."""
        for part in (1, 0):
            kept = [size - missed for size, missed in zip(sizes, self._to_miss, strict=True)]
            over = sum(kept) + sum(map(len, self._ghosts)) - max(limit, sum(sizes))
            self._to_miss[part] += min(max(over, 0), kept[part])

    def _general(self, payload: Payload, missed: bool) -> list[Payload]:
        """Return what is sent when a cluster comes: ghosts before it, itself, ghosts at the end."""
        old_id = int(payload[0])
        if self._new_id[old_id] >= 0 or old_id >= self._ends[1]:
            return []
        part = int(old_id >= self._ends[0])
        distance = float(_ranges(payload[None])[0])
        sent = self._insert(0, np.inf if part else distance)
        sent += self._insert(1, distance) if part else []
        behind = self._ends[part] - 1 - old_id
        if self._to_miss[part] and (missed or self._to_miss[part] > behind):
            self._to_miss[part] -= 1
            self._new_id[old_id] = _DONE
        else:
            self._new_id[old_id] = self._next_id
            sent.append(self._numbered(payload))
        if old_id == self._ends[1] - 1:
            sent += self._insert(0, np.inf) + self._insert(1, np.inf)
        return sent

    def _insert(self, part: int, range_m: float) -> list[Payload]:
        """Return the ghosts of a list that come before a range."""
        sent = []
        ghosts = self._ghosts[part]
        while ghosts and ghosts[0].range_m < range_m:
            ghost = ghosts.popleft()
            if ghost.quality is not None:
                ghost.quality[0] = self._next_id
                self._ghost_qualities.append(ghost.quality)
            sent.append(self._numbered(ghost.general))
        return sent

    def _numbered(self, payload: Payload) -> Payload:
        payload[0] = self._next_id
        self._next_id += 1
        return payload

    def _quality(self, payload: Payload) -> list[Payload]:
        """Return what is sent when a quality frame comes: those of ghosts before it, and itself."""
        sent = []
        old_id = int(payload[0])
        new_id = int(self._new_id[old_id])
        if 0 <= new_id < _DONE:
            self._new_id[old_id] = _DONE
            payload[0] = new_id
            while self._ghost_qualities and self._ghost_qualities[0][0] < new_id:
                sent.append(self._ghost_qualities.popleft())
            sent.append(payload)
            self._qualities_left -= 1
        if not self._qualities_left:
            sent += self._ghost_qualities
            self._ghost_qualities.clear()
        return sent


def _ghosts_of(
    before: RadarScan, drawn: Sequence[RadarDegradation]
) -> tuple[deque[_Ghost], deque[_Ghost]]:
    """Return the ghosts that the scan before would have got, near and far, ascending in range.

    They are what the degraded scan has over the plain one.
    """
    found: tuple[deque[_Ghost], deque[_Ghost]] = (deque(), deque())
    plain = {bytes(row[1:]) for row in _payloads(before)[0]}
    for one in drawn:
        if not one.ghosts:
            continue
        haunted = radar.apply(replace(one, kind="ghosts"), before)
        generals, qualities = _payloads(haunted)
        for place, payload in enumerate(generals):
            if bytes(payload[1:]) not in plain:
                quality = None if qualities is None else qualities[place]
                distance = float(np.hypot(haunted.x[place], haunted.y[place]))
                found[int(place >= haunted.near)].append(_Ghost(distance, payload, quality))
    near, far = (deque(sorted(part, key=lambda ghost: ghost.range_m)) for part in found)
    return near, far


def _payloads(scan: RadarScan) -> tuple[Payload, Payload | None]:
    """Return the payloads of a scan's general and quality frames, (n, 8) each."""
    frames = encode_scan(scan)
    general = frames.data[1 : len(scan) + 1].copy()
    return general, frames.data[len(scan) + 1 :].copy() if scan.pdh0 is not None else None


def _scan_of(rows: NDArray[np.float64]) -> RadarScan:
    """Return clusters as a scan of their own."""
    count = rows.shape[1]
    x, y, vx, vy, rcs = rows.astype(np.float32)
    return RadarScan(
        sensor="",
        sensor_id=0,
        sequence=0,
        stamp_ns=0,
        stamp_source="read",
        mode="cluster",
        meas_counter=0,
        near=count,
        far=0,
        id=np.arange(count, dtype=np.uint8),
        x=x,
        y=y,
        vx=vx,
        vy=vy,
        rcs=rcs,
        dyn_prop=np.zeros(count, np.uint8),
    )


def _codec() -> MessageCodec:
    return ars408().message(CAN_ID[Kind.CLUSTER_GENERAL])


def _rows(scan: RadarScan) -> NDArray[np.float64]:
    return np.array([scan.x, scan.y, scan.vx, scan.vy, scan.rcs], np.float64)


def _echoes_db(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    return radar.echo_db(np.hypot(rows[0], rows[1]), rows[4])


def _ranges(payloads: Payload) -> NDArray[np.float64]:
    columns = _codec().decode(payloads)
    return np.asarray(np.hypot(columns["Cluster_DistLong"], columns["Cluster_DistLat"]))
