"""A simulated ARS 408-21 in cluster mode that sees the simulated world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.can_frames import CanFrames
from drivers.scan import RadarScan
from models.degrade.draw import DrawKey
from models.sensor import ARS408, RadarSensor
from models.world.beam import FAR, NEAR
from models.world.can import cycle_frames
from models.world.clusters import QUALITY, describe
from models.world.echoes import measure
from models.world.objects import concatenate
from models.world.points import Points
from models.world.reflectors import Reflectors, join, reflectors
from models.world.road import EPOCH_NS, World
from models.world.sight import Antenna, look

MOUNT_X = 3.4
"""Default place of the radar: ahead of the middle of the rear axle, m."""

_COUNTER_STEP = 2
_JITTER_S = 1e-3


class WorldRadar:
    """The radar of one drive; scan k is the same whoever asks for it, and in whatever order.

    Parameters
    ----------
    world:
        What it sees.
    sensor, sensor_id:
        Its name in the scene, and its SensorID 0–7.
    x_m, y_m, yaw_rad:
        Where it is mounted: ahead and left of the middle of the rear axle, and turned left.
    quality:
        Whether it sends quality frames (and then at most 125 clusters instead of 250).
    description:
        The sensor's data sheet.
    """

    def __init__(
        self,
        world: World,
        sensor: str = "radar",
        sensor_id: int = 0,
        *,
        x_m: float = MOUNT_X,
        y_m: float = 0.0,
        yaw_rad: float = 0.0,
        quality: bool = True,
        description: RadarSensor = ARS408,
    ) -> None:
        self.world = world
        self.sensor = sensor
        self.sensor_id = sensor_id
        self.quality = quality
        self.description = description
        self._mount = (x_m, y_m, yaw_rad)
        scenery, traffic = world.scenery, world.traffic
        points = reflectors(scenery.kind, scenery.length, scenery.width, scenery.look)
        self._standing = points.placed(scenery)
        self._first = np.searchsorted(points.owner, np.arange(len(scenery) + 1))
        self._mobile = reflectors(traffic.kind, traffic.length, traffic.width, traffic.look)
        self._by_look = np.argsort(traffic.look)

    def scans(self) -> Iterator[RadarScan]:
        """Yield every cycle of the drive."""
        sequence = 0
        while self.time(sequence) < self.world.duration_s:
            yield self.scan(sequence)
            sequence += 1

    def frames(self) -> Iterator[CanFrames]:
        """Yield every cycle as CAN frames in order of time, with all that goes on beside it."""
        start_ns = EPOCH_NS
        for scan in self.scans():
            end_ns = EPOCH_NS + round(self.time(scan.sequence + 1) * 1e9)
            yield cycle_frames(self.world, scan, start_ns, end_ns)
            start_ns = end_ns

    def time(self, sequence: int) -> float:
        """Return when cycle ``sequence`` is measured, s from the start, with its jitter."""
        draw = DrawKey(self.world.seed, self.sensor, sequence).generator("time")
        return sequence * self.description.cycle_s + draw.uniform(0, 2 * _JITTER_S)

    def scan(self, sequence: int) -> RadarScan:
        """Return cycle ``sequence``."""
        t_s = self.time(sequence)
        rng = DrawKey(self.world.seed, self.sensor, sequence).generator("scan")
        antenna = self.antenna(t_s)
        points = self.points(t_s)
        sensor = self.description
        first, second = (measure(points, beam, sensor, rng) for beam in (NEAR, FAR))
        near = describe(first, NEAR, antenna, np.ones(len(first), bool), rng)
        far = describe(second, FAR, antenna, second.confirmed_by(first), rng)
        cap = sensor.max_clusters_with_quality if self.quality else sensor.max_clusters
        n_near = min(len(near["x"]), cap)
        n_far = min(len(far["x"]), cap - n_near)
        columns: dict[str, Any] = {
            name: np.concatenate([near[name][:n_near], far[name][:n_far]])
            for name in near
            if self.quality or name not in QUALITY
        }
        return RadarScan(
            sensor=self.sensor,
            sensor_id=self.sensor_id,
            sequence=sequence,
            stamp_ns=EPOCH_NS + round(t_s * 1e9),
            stamp_source="simulated",
            mode="cluster",
            meas_counter=sequence * _COUNTER_STEP % 65536,
            near=n_near,
            far=n_far,
            id=np.arange(n_near + n_far, dtype=np.uint8),
            **columns,
        )

    def antenna(self, t_s: float) -> Antenna:
        """Return where the radar is at ``t_s`` seconds from the start, and how it moves."""
        ego = self.world.ego(t_s)
        x, y, yaw = self._mount
        cos, sin = np.cos(ego.heading), np.sin(ego.heading)
        ahead, left = ego.speed - ego.yaw_rate * y, ego.yaw_rate * x
        return Antenna(
            x=ego.x + x * cos - y * sin,
            y=ego.y + x * sin + y * cos,
            heading=ego.heading + yaw,
            ahead=ahead * np.cos(yaw) + left * np.sin(yaw),
            left=left * np.cos(yaw) - ahead * np.sin(yaw),
            yaw_rate=ego.yaw_rate,
        )

    def points(self, t_s: float) -> Points:
        """Return what every reflector in sight sends back at ``t_s`` seconds from the start."""
        here = self.world.standing(self.world.ego(t_s).s)
        standing = self._standing[self._first[here.start] : self._first[here.stop]]
        standing = replace(standing, owner=standing.owner - here.start)
        moving = self.world.moving(t_s)
        track = self._by_look[
            np.searchsorted(self.world.traffic.look, moving.look, sorter=self._by_look)
        ]
        mobile = _of_owners(self._mobile, track).placed(moving)
        mobile = replace(mobile, owner=mobile.owner + here.stop - here.start)
        objects = concatenate([self.world.scenery[here], moving])
        return look(self.antenna(t_s), join(standing, mobile), objects, here.stop - here.start)


def _of_owners(points: Reflectors, owners: NDArray[np.intp]) -> Reflectors:
    """Return the points of some owners, whose number becomes the place in ``owners``."""
    first = np.searchsorted(points.owner, owners)
    count = np.searchsorted(points.owner, owners, side="right") - first
    number = np.repeat(np.arange(len(owners)), count)
    chosen = np.arange(len(number)) + np.repeat(first - np.cumsum(count) + count, count)
    return replace(points[chosen], owner=number)
