"""Radar sensors as descriptions: limits, accuracies and the CAN grid of one product.

Another radar is another instance of ``RadarSensor``, not new code.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

KILOMETRES_PER_HOUR = 1.0 / 3.6
"""1 km/h in m/s."""


@dataclass(frozen=True)
class GridField:
    """Values that one CAN signal can carry: ``offset + step * k`` for k = 0 .. count - 1.

    Attributes
    ----------
    name:
        Field of ``RadarScan``.
    step, offset:
        In the field's unit (m, m/s, dBm²).
    count:
        Number of raw values.
    """

    name: str
    step: float
    offset: float
    count: int


@dataclass(frozen=True)
class Band:
    """Ranges below ``range_max_m`` reach to ``azimuth_deg`` on either side."""

    range_max_m: float
    azimuth_deg: float


@dataclass(frozen=True)
class RadarSensor:
    """What a radar can measure, how well, and what its bus can carry.

    Accuracies are taken as one standard deviation. Tables by azimuth are linear between their
    nodes and constant beyond the last one.

    Attributes
    ----------
    range_min_m, range_max_m:
        Limits of the measured range.
    near_accuracy_range_m:
        Below this range the near scan's accuracy and resolution hold, above it the far scan's.
    azimuth_nodes_deg:
        Nodes of the near tables.
    near_range_m:
        Reach of the near scan at each node, m.
    far_azimuth_deg, near_azimuth_deg:
        Half field of view of the far and near scan.
    near_range_std_m, far_range_std_m, near_azimuth_std_deg, far_azimuth_std_deg:
        Accuracy; the near azimuth one value a node.
    velocity_std:
        Accuracy of the radial velocity, m/s.
    near_range_resolution_m, far_range_resolution_m:
        Two targets closer than this merge.
    near_azimuth_resolution_deg, far_azimuth_resolution_deg:
        The same in azimuth; the near one value a node.
    near_velocity_resolution, far_velocity_resolution:
        The same in radial velocity, m/s.
    velocity_min, velocity_max:
        Limits of the radial velocity, m/s; approaching is negative.
    grid:
        CAN grid of x, y, vx, vy, rcs of a cluster, in this order.
    max_clusters, max_clusters_with_quality:
        Clusters in a cycle without and with quality frames.
    cycle_s:
        Duration of one measurement cycle.
    ghost_bands:
        Where uniform ghosts may appear: the first band whose range limit is above theirs.
    detection_floor_db:
        RCS − 40 log10(range) of the weakest cluster in a typical scan, dB: see
        ``models.degrade.radar.threshold_db``.
    pdh0_classes:
        The false-alarm classes that this sensor really sends.
    """

    name: str
    range_min_m: float
    range_max_m: float
    near_accuracy_range_m: float
    azimuth_nodes_deg: tuple[float, ...]
    near_range_m: tuple[float, ...]
    near_azimuth_deg: float
    far_azimuth_deg: float
    near_range_std_m: float
    far_range_std_m: float
    near_azimuth_std_deg: tuple[float, ...]
    far_azimuth_std_deg: float
    velocity_std: float
    near_range_resolution_m: float
    far_range_resolution_m: float
    near_azimuth_resolution_deg: tuple[float, ...]
    far_azimuth_resolution_deg: float
    near_velocity_resolution: float
    far_velocity_resolution: float
    velocity_min: float
    velocity_max: float
    grid: tuple[GridField, ...]
    max_clusters: int
    max_clusters_with_quality: int
    cycle_s: float
    ghost_bands: tuple[Band, ...]
    detection_floor_db: float
    pdh0_classes: tuple[int, ...]

    def is_near(self, range_m: ArrayLike) -> NDArray[np.bool_]:
        """Return where the near scan's accuracy holds, by range in m."""
        return np.asarray(range_m) < self.near_accuracy_range_m

    def _by_azimuth(self, table: tuple[float, ...], azimuth_rad: ArrayLike) -> FloatArray:
        return np.asarray(np.interp(np.abs(azimuth_rad), self._nodes_rad, table))

    @cached_property
    def _nodes_rad(self) -> FloatArray:
        return np.radians(self.azimuth_nodes_deg)

    @cached_property
    def _near_azimuth_std(self) -> FloatArray:
        return np.radians(self.near_azimuth_std_deg)

    def range_std(self, range_m: ArrayLike) -> FloatArray:
        """Return the accuracy of the range, m, by range in m."""
        return np.asarray(self._range_stds.take(self.is_near(range_m)))

    @cached_property
    def _range_stds(self) -> FloatArray:
        """Far and near."""
        return np.array([self.far_range_std_m, self.near_range_std_m])

    def azimuth_std(self, range_m: ArrayLike, azimuth_rad: ArrayLike) -> FloatArray:
        """Return the accuracy of the azimuth, rad, by range in m and azimuth in rad."""
        near = np.interp(np.abs(azimuth_rad), self._nodes_rad, self._near_azimuth_std)
        return np.where(self.is_near(range_m), near, math.radians(self.far_azimuth_std_deg))

    def range_resolution(self, range_m: ArrayLike) -> FloatArray:
        """Return the range resolution, m, by range in m."""
        near, far = self.near_range_resolution_m, self.far_range_resolution_m
        return np.where(self.is_near(range_m), near, far)

    def azimuth_resolution(self, range_m: ArrayLike, azimuth_rad: ArrayLike) -> FloatArray:
        """Return the azimuth resolution, rad, by range in m and azimuth in rad."""
        near = self._by_azimuth(self.near_azimuth_resolution_deg, azimuth_rad)
        degrees = np.where(self.is_near(range_m), near, self.far_azimuth_resolution_deg)
        return np.asarray(np.radians(degrees))

    def velocity_resolution(self, range_m: ArrayLike) -> FloatArray:
        """Return the resolution of the radial velocity, m/s, by range in m."""
        near, far = self.near_velocity_resolution, self.far_velocity_resolution
        return np.where(self.is_near(range_m), near, far)

    def sees_near(self, range_m: ArrayLike, azimuth_rad: ArrayLike) -> NDArray[np.bool_]:
        """Return what lies inside the near scan's field of view."""
        inside = np.abs(azimuth_rad) <= math.radians(self.near_azimuth_deg)
        reach = self._by_azimuth(self.near_range_m, azimuth_rad)
        distance = np.asarray(range_m)
        return np.asarray(inside & (distance >= self.range_min_m) & (distance <= reach))

    def sees_far(self, range_m: ArrayLike, azimuth_rad: ArrayLike) -> NDArray[np.bool_]:
        """Return what lies inside the far scan's field of view."""
        inside = np.abs(azimuth_rad) <= math.radians(self.far_azimuth_deg)
        distance = np.asarray(range_m)
        reached = (distance >= self.range_min_m) & (distance <= self.range_max_m)
        return np.asarray(inside & reached)

    def ghost_azimuth(self, range_m: float) -> float:
        """Return the half field of view in which ghosts appear, rad, at a range in m."""
        limits, widths = self._ghost_bands
        return widths[bisect_right(limits, range_m)]

    @cached_property
    def _ghost_bands(self) -> tuple[list[float], list[float]]:
        limits = [band.range_max_m for band in self.ghost_bands[:-1]]
        return limits, [math.radians(band.azimuth_deg) for band in self.ghost_bands]

    @cached_property
    def _grid_by_count(self) -> dict[int, FloatArray]:
        """What ``_grid_of`` made before."""
        return {}

    def _grid_of(self, n: int) -> FloatArray:
        """Return step, offset, first and last raw value of each field, (4, 5, n).

        As wide as a scan's rows: NumPy takes twice as long to widen a column every time.
        """
        wide = self._grid_by_count.get(n)
        if wide is None:
            columns = np.array([[one.step, one.offset, 0, one.count - 1] for one in self.grid]).T
            wide = np.repeat(columns[:, :, None], n, axis=2)
            if n <= 2 * self.max_clusters:  # as many again, of mirror images or a jammer's ghosts
                self._grid_by_count[n] = wide
        return wide

    def to_grid(self, name: str, values: ArrayLike) -> FloatArray:
        """Return finite values moved to the nearest one that the bus can carry, float64.

        Parameters
        ----------
        name:
            ``x``, ``y``, ``vx``, ``vy`` or ``rcs``.
        values:
            In the field's unit; beyond the grid's ends they become its ends.
        """
        field = next(field for field in self.grid if field.name == name)
        raw = np.rint((np.asarray(values, np.float64) - field.offset) / field.step)
        return np.asarray(np.clip(raw, 0, field.count - 1) * field.step + field.offset)

    def rows_to_grid(self, rows: FloatArray) -> FloatArray:
        """Return ``to_grid`` of x, y, vx, vy and rcs at once; ``rows`` is (5, n), finite."""
        step, offset, first, last = self._grid_of(rows.shape[1])
        raw: FloatArray = rows - offset
        raw /= step
        np.rint(raw, out=raw)
        np.maximum(raw, first, out=raw)
        np.minimum(raw, last, out=raw)
        raw *= step
        raw += offset
        return raw


ARS408 = RadarSensor(
    name="ARS 408-21",
    range_min_m=0.2,
    range_max_m=250.0,
    near_accuracy_range_m=70.0,
    azimuth_nodes_deg=(0.0, 45.0, 60.0),
    near_range_m=(100.0, 100.0, 20.0),
    near_azimuth_deg=60.0,
    far_azimuth_deg=9.0,
    near_range_std_m=0.10,
    far_range_std_m=0.40,
    near_azimuth_std_deg=(0.3, 1.0, 5.0),
    far_azimuth_std_deg=0.1,
    velocity_std=0.1 * KILOMETRES_PER_HOUR,
    near_range_resolution_m=0.39,
    far_range_resolution_m=1.79,
    near_azimuth_resolution_deg=(3.2, 4.5, 12.3),
    far_azimuth_resolution_deg=1.6,
    near_velocity_resolution=0.43 * KILOMETRES_PER_HOUR,
    far_velocity_resolution=0.37 * KILOMETRES_PER_HOUR,
    velocity_min=-400.0 * KILOMETRES_PER_HOUR,
    velocity_max=200.0 * KILOMETRES_PER_HOUR,
    grid=(
        GridField("x", 0.2, -500.0, 2**13),
        GridField("y", 0.2, -102.3, 2**10),
        GridField("vx", 0.25, -128.0, 2**10),
        GridField("vy", 0.25, -64.0, 2**9),
        GridField("rcs", 0.5, -64.0, 2**8),
    ),
    max_clusters=250,
    max_clusters_with_quality=125,
    cycle_s=0.072,
    ghost_bands=(Band(10.0, 60.0), Band(100.0, 40.0), Band(float("inf"), 9.0)),
    detection_floor_db=-80.0,
    pdh0_classes=(1, 3, 6),
)
"""Continental ARS 408-21 by its data sheet; near reach 100 m (70 m in its short-range mode)."""
