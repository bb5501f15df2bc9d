"""A simulated ARS 408-21 in cluster mode that sees the simulated world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.degrade.draw import DrawKey
from models.sensor import ARS408, RadarSensor
from models.world.clusters import Columns, describe
from models.world.echoes import FAR, NEAR, Points, measure
from models.world.objects import Floats, Kind, Objects, concatenate
from models.world.reflectors import Reflectors, reflectors
from models.world.road import EPOCH_NS, Ego, World

MOUNT_X = 3.4
"""Default place of the radar: ahead of the middle of the rear axle, m."""

_WAVE_NUMBER = 2 * np.pi / 0.0039
_COUNTER_STEP = 2
_BINS = 480
_OPAQUE = (Kind.CAR, Kind.VAN, Kind.TRUCK, Kind.BUILDING, Kind.WALL)


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
        self._static = reflectors(world.scenery)
        self._first = np.searchsorted(self._static.owner, np.arange(len(world.scenery) + 1))

    def scans(self) -> Iterator[RadarScan]:
        """Yield every cycle of the drive."""
        sequence = 0
        while self.time(sequence) < self.world.duration_s:
            yield self.scan(sequence)
            sequence += 1

    def time(self, sequence: int) -> float:
        """Return when cycle ``sequence`` is measured, s from the start, with its jitter."""
        jitter = DrawKey(self.world.seed, self.sensor, sequence).generator("time").uniform(-1, 1)
        return sequence * self.description.cycle_s + float(1e-3 * (1 + jitter))

    def scan(self, sequence: int) -> RadarScan:
        """Return cycle ``sequence``."""
        t_s = self.time(sequence)
        rng = DrawKey(self.world.seed, self.sensor, sequence).generator("scan")
        ego = self.world.ego(t_s)
        points = self._points(ego, t_s)
        motion = self._motion(ego)
        limit = self.description.max_clusters_with_quality
        cap = limit if self.quality else self.description.max_clusters
        lists = []
        for beam in (NEAR, FAR):
            echoes = measure(points, beam, self.description, rng)
            lists.append(describe(echoes, beam, motion, self.description, rng))
        near = min(len(lists[0]["x"]), cap)
        far = min(len(lists[1]["x"]), cap - near)
        columns: Columns = {
            name: np.concatenate([lists[0][name][:near], lists[1][name][:far]])
            for name in lists[0]
            if self.quality or not _is_quality(name)
        }
        return RadarScan(
            sensor=self.sensor,
            sensor_id=self.sensor_id,
            sequence=sequence,
            stamp_ns=EPOCH_NS + round(t_s * 1e9),
            stamp_source="simulated",
            mode="cluster",
            meas_counter=sequence * _COUNTER_STEP % 65536,
            near=near,
            far=far,
            id=np.arange(near + far, dtype=np.uint8),
            **columns,
        )

    def _pose(self, ego: Ego) -> tuple[float, float, float]:
        """Return the radar's x, y and heading in the world."""
        x, y, yaw = self._mount
        cos, sin = np.cos(ego.heading), np.sin(ego.heading)
        return ego.x + x * cos - y * sin, ego.y + x * sin + y * cos, ego.heading + yaw

    def _motion(self, ego: Ego) -> tuple[float, float, float]:
        """Return the radar's velocity ahead and to its left, m/s, and its yaw rate, rad/s."""
        x, y, yaw = self._mount
        ahead, left = ego.speed - ego.yaw_rate * y, ego.yaw_rate * x
        cos, sin = np.cos(yaw), np.sin(yaw)
        return ahead * cos + left * sin, left * cos - ahead * sin, ego.yaw_rate

    def _points(self, ego: Ego, t_s: float) -> Points:
        """Return what every reflector around sends back to the radar."""
        here = self.world.standing(ego.s)
        moving = self.world.moving(t_s)
        static = self._static[self._first[here.start] : self._first[here.stop]]
        mobile = reflectors(moving)
        both = _join(static, mobile, here, len(moving))
        objects = concatenate([self.world.scenery[here], moving])
        x, y, heading = self._pose(ego)
        dx, dy = both.x - x, both.y - y
        r = np.hypot(dx, dy)
        toward = np.arctan2(dy, dx)
        azimuth = np.angle(np.exp(1j * (toward - heading)))
        keep = (np.abs(azimuth) < 1.32) & (r < 260) & (r > 0.3)
        both, dx, dy, r, toward, azimuth = (
            value[keep] for value in (both, dx, dy, r, toward, azimuth)
        )
        ahead, left, _ = self._motion(ego)
        own = ahead * np.cos(azimuth) + left * np.sin(azimuth)
        over_ground = both.vx * np.cos(toward) + both.vy * np.sin(toward)
        pace = np.hypot(both.vx, both.vy)
        shadow = _shadow(objects, both.owner, x, y, heading, r, azimuth)
        field = both.amplitude * _fluctuation(both, dx, dy) * _facing(both, toward)
        return Points(
            r,
            azimuth,
            over_ground - own,
            field * shadow * np.exp(-2j * _WAVE_NUMBER * r),
            pace > 0.3,
            (pace > 0.3) & (np.abs(over_ground) < 0.7 * pace),
        )


def _is_quality(name: str) -> bool:
    return name in ("pdh0", "ambig_state", "invalid_state") or name.endswith("_rms")


def _join(static: Reflectors, mobile: Reflectors, here: slice, moving: int) -> Reflectors:
    """Return both, their owners counted within the window of standing, then moving objects."""
    columns = {
        field.name: np.concatenate([getattr(static, field.name), getattr(mobile, field.name)])
        for field in fields(Reflectors)
    }
    n = len(static)
    columns["owner"][:n] -= here.start
    columns["owner"][n:] += here.stop - here.start
    return Reflectors(**columns)


def _fluctuation(points: Reflectors, dx: Floats, dy: Floats) -> NDArray[np.complex128]:
    """Return the complex factor by which amplitudes fluctuate with the aspect."""
    turn = points.phases + points.waves[..., 0] * dx[:, None] + points.waves[..., 1] * dy[:, None]
    speckle = np.exp(1j * turn).sum(axis=1) / np.sqrt(turn.shape[1])
    result: NDArray[np.complex128] = np.sqrt(points.steady) + np.sqrt(1 - points.steady) * speckle
    return result


def _facing(points: Reflectors, toward: Floats) -> Floats:
    """Return the factor on the amplitude of a faced point seen from the radar, 0 to 1."""
    cosine = -np.cos(toward - points.facing)
    result: Floats = np.where(np.isnan(cosine), 1.0, np.sqrt(np.clip(cosine + 0.1, 0, 1)))
    return result


def _shadow(
    objects: Objects,
    owner: NDArray[np.intp],
    x: float,
    y: float,
    heading: float,
    r: Floats,
    azimuth: Floats,
) -> Floats:
    """Return the factor on the amplitude behind opaque objects; vehicles let some pass below."""
    opaque = np.isin(objects.kind, _OPAQUE)
    chosen = objects[opaque]
    number = np.flatnonzero(opaque)
    corners = chosen.corners() - (x, y)
    distance = np.hypot(corners[..., 0], corners[..., 1]).min(axis=1)
    angle = np.angle(np.exp(1j * (np.arctan2(corners[..., 1], corners[..., 0]) - heading)))
    low, high = angle.min(axis=1), angle.max(axis=1)
    ahead = high - low < np.pi / 2
    loss = np.where(np.isin(chosen.kind, (Kind.BUILDING, Kind.WALL)), 0.03, 0.35)
    behind = (
        (azimuth[:, None] > low)
        & (azimuth[:, None] < high)
        & (r[:, None] > distance + 0.5)
        & (owner[:, None] != number)
        & ahead
    )
    result: Floats = np.exp(behind @ np.log(loss))
    return result
