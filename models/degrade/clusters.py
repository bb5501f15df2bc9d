"""The clusters of one scan while they are being degraded, and how they leave again."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from functools import cache
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from drivers.scan import RadarScan
from models.sensor import RadarSensor

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]

_FIELDS = ("x", "y", "vx", "vy", "rcs")
_MADE = {*_FIELDS, "id", "near", "far", "invalid_state", "frames_lost"}
"""Fields that ``sent`` makes anew."""
_PDH0_BOUNDS = np.array([0.25, 0.5, 0.75, 0.9, 0.99, 0.999, 1.0])
_PDH0_MIDDLES = np.array([1.0, 0.125, 0.375, 0.625, 0.825, 0.945, 0.9945, 0.9995])
_RMS_INDICES_PER_DECADE = 30 / math.log10(2000)


def check_clusters(scan: RadarScan) -> None:
    """Raise ``InputError`` unless the scan is in cluster mode."""
    if scan.mode != "cluster":
        raise InputError(f"scan of {scan.sensor}", "in object mode", "degrade clusters instead")


class Clusters:
    """Clusters in float64, changed in place, that leave as the sensor could have sent them.

    A cluster with a NaN or infinite value is left out and counted: nothing that a CAN bus carries
    decodes to one.

    Attributes
    ----------
    rows:
        (5, n): x, y (m), vx, vy (m/s), rcs (dBm²).
    range:
        (n,) m.
    order:
        (n,) m: the range by which the sensor sorts its lists.
    far:
        (n,) whether the far list holds it.
    source:
        (n,) the cluster of the scan from which it comes.
    invalid_state:
        (n,) uint8, or None without quality.
    masked:
        How many clusters were left out.
    """

    def __init__(self, scan: RadarScan, sensor: RadarSensor) -> None:
        self.scan = scan
        self.sensor = sensor
        table = np.zeros((7, len(scan)))
        for row, name in enumerate(_FIELDS):
            table[row] = getattr(scan, name)
        self.source = np.arange(len(scan))
        self.far = scan.id >= scan.near
        self.invalid_state = scan.invalid_state
        finite = np.isfinite(table)
        self.masked = 0
        if np.count_nonzero(finite) < finite.size:
            usable = np.flatnonzero(finite.all(axis=0))
            self.masked = len(scan) - len(usable)
            table = table.take(usable, axis=1)
            self._take(usable)
        self._hold(table)
        np.hypot(table[0], table[1], out=self.range)
        self._put_in_order()

    def __len__(self) -> int:
        return self.source.size

    def _hold(self, table: FloatArray) -> None:
        """Hold the rows, the range and the order of each cluster in one array, (7, n)."""
        self._table = table
        self.rows, self.range, self.order = table[:5], table[5], table[6]

    def _put_in_order(self) -> None:
        """Find the range by which the sensor sorted each list.

        It sorts by what it measured, before rounding, so lists on the wire step back by up to a
        cell of the grid. The running maximum keeps that order.
        """
        distance, order = self.range, self.order
        far = np.count_nonzero(self.far)
        if not far:
            np.maximum.accumulate(distance, out=order)
            return
        near = len(self) - far
        if np.count_nonzero(self.far[near:]) == far:  # as the sensor sends them
            np.maximum.accumulate(distance[:near], out=order[:near])
            np.maximum.accumulate(distance[near:], out=order[near:])
            return
        for part in (~self.far, self.far):
            order[part] = np.maximum.accumulate(distance[part])

    @property
    def azimuth(self) -> FloatArray:
        """(n,) rad, to the left."""
        return np.asarray(np.arctan2(self.rows[1], self.rows[0]))

    def keep(self, kept: Mask) -> None:
        """Leave out the clusters that are not kept."""
        (index,) = kept.nonzero()
        self._hold(self._table.take(index, axis=1))
        self._take(index)

    def _take(self, index: Index) -> None:
        self.source, self.far = self.source[index], self.far[index]
        if self.invalid_state is not None:
            self.invalid_state = self.invalid_state[index]

    def move(self, distance: FloatArray, azimuth: FloatArray) -> None:
        """Put each cluster at another range (m) and azimuth (rad)."""
        np.multiply(distance, np.cos(azimuth), out=self.rows[0])
        np.multiply(distance, np.sin(azimuth), out=self.rows[1])
        self.order += distance - self.range
        self.range[:] = distance

    def add(self, rows: FloatArray, lender: Index, invalid_state: int | list[int]) -> None:
        """Add clusters, each with the DynProp and quality of a lender already here.

        Parameters
        ----------
        rows:
            (5, m), as in ``rows``.
        lender:
            (m,) which clusters lend.
        invalid_state:
            One for all or one a cluster.
        """
        here, distance = len(self), np.hypot(rows[0], rows[1])
        self.far = np.concatenate([self.far, self._joins_far(distance)])
        table = np.empty((7, here + len(distance)))
        table[:, :here] = self._table
        table[:5, here:], table[5:, here:] = rows, distance
        self._hold(table)
        self.source = np.concatenate([self.source, self.source[lender]])
        if self.invalid_state is not None:
            theirs = np.full(len(distance), invalid_state, np.uint8)
            self.invalid_state = np.concatenate([self.invalid_state, theirs])

    def _joins_far(self, distance: FloatArray) -> Mask:
        """Return which newcomers join the far list: those beyond what the near list reaches."""
        if not np.count_nonzero(self.far):
            return np.zeros(len(distance), np.bool_)
        return np.asarray(distance > self.range[~self.far].max(initial=-np.inf))

    def sent(self) -> RadarScan:
        """Return the scan that the sensor would send.

        Values are on the CAN grid; the near list comes before the far list, each sorted by range;
        IDs count from 0; and the list ends where a cycle is full. It is of the same type as the
        scan that came, every array of which goes with its cluster.
        """
        scan, sensor = self.scan, self.sensor
        with_quality = scan.pdh0 is not None
        limit = sensor.max_clusters_with_quality if with_quality else sensor.max_clusters
        on_grid = sensor.rows_to_grid(self.rows)
        distance = np.hypot(on_grid[0], on_grid[1])
        cell = math.hypot(sensor.grid[0].step, sensor.grid[1].step)
        order = np.minimum(np.maximum(self.order, distance - cell), distance + cell)
        index = np.lexsort((order, self.far))[:limit]
        self._take(index)
        far = int(np.count_nonzero(self.far))
        on_wire = on_grid.take(index, axis=1).astype(np.float32)
        scan_type: Any = type(scan)
        names, get = _others(scan_type)
        source = self.source
        others = [one[source] if isinstance(one, np.ndarray) else one for one in get(scan)]
        x, y, vx, vy, rcs = on_wire
        made: RadarScan = scan_type(
            id=np.arange(len(self), dtype=np.uint8),
            x=x,
            y=y,
            vx=vx,
            vy=vy,
            rcs=rcs,
            near=len(self) - far,
            far=far,
            invalid_state=self.invalid_state,
            frames_lost=scan.frames_lost + self.masked,
            **dict(zip(names, others, strict=True)),
        )
        return made


@cache
def _others(scan_type: type[RadarScan]) -> tuple[tuple[str, ...], attrgetter[tuple[Any, ...]]]:
    """Return the names of the fields that go with a cluster as they are, and what gets them all."""
    names = tuple(field.name for field in fields(scan_type) if field.name not in _MADE)
    return names, attrgetter(*names)


def consistent_quality(scan: RadarScan, drop_db: float, sensor: RadarSensor) -> RadarScan:
    """Return the scan with quality fields that follow a loss of signal-to-noise ratio.

    The RMS indices grow by the Cramér–Rao bound: their table is logarithmic, so a loss is a shift.
    The false-alarm probability becomes p^(1/loss), the law of a Rayleigh noise floor. A cluster
    without an estimate (RMS 0 or 31) keeps it, and so does vy_rms, which the sensor never changes.
    """
    changed: dict[str, Any] = {}
    shift = round(drop_db / 20 * _RMS_INDICES_PER_DECADE)
    for name in ("x_rms", "y_rms", "vx_rms"):
        old = getattr(scan, name)
        if old is not None:
            shifted = np.minimum(old.astype(np.int64) + shift, 30)
            changed[name] = np.where((old > 0) & (old < 31), shifted, old).astype(np.uint8)
    if scan.pdh0 is not None:
        classes = np.array(sensor.pdh0_classes, np.uint8)
        likely = _PDH0_MIDDLES ** (10.0 ** (-drop_db / 10.0))
        place = np.searchsorted(_PDH0_BOUNDS[classes[:-1] - 1], likely)
        lookup = np.maximum(classes[place], np.arange(8)).astype(np.uint8)
        lookup[0] = 0
        changed["pdh0"] = lookup[scan.pdh0]
    return replace(scan, **changed)
