"""From point reflectors to measured echoes: antenna, noise, resolution, detection, accuracy."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from models.sensor import RadarSensor
from models.world.objects import Floats

DETECTION_DB = 13.0
"""SNR that a detection needs."""

RCS_FLOOR = -5.0
"""The sensor reports nothing weaker, dBm²."""

_WOBBLE = 0.035
"""Scale of the radial motion of what stands (leaves, wires) and of Doppler errors, m/s."""


class Motion(IntEnum):
    """How a reflector moves over ground."""

    STANDING = 0
    MOVING = 1
    CROSSING = 2
    STOPPED = 3


@dataclass(frozen=True, slots=True)
class Beam:
    """One of the radar's two scans.

    Attributes
    ----------
    far:
        Whether it is the far scan.
    half_width:
        Half field of view, rad.
    fringe:
        How far beyond it strong echoes still come in, rad.
    range_min, range_max:
        m.
    reach:
        Range at which a target of ``RCS_FLOOR`` on boresight has an SNR of ``DETECTION_DB``, m.
    edge_loss_db:
        Two-way loss of gain at the edge of the field of view (parabolic in azimuth), dB.
    outside_loss_db:
        Further loss in the fringe, dB.
    """

    far: bool
    half_width: float
    fringe: float
    range_min: float
    range_max: float
    reach: float
    edge_loss_db: float
    outside_loss_db: float


NEAR = Beam(False, np.radians(60.0), np.radians(15.0), 0.5, 129.7, 83.0, 10.0, 15.0)
FAR = Beam(True, np.radians(9.0), np.radians(4.0), 10.0, 258.0, 160.0, 3.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """What arrives at the radar from N reflectors, (N,) each.

    Attributes
    ----------
    r, azimuth, speed:
        m, rad, m/s (radial, approaching negative).
    field:
        complex128, square root of the radar cross section in m², with phase.
    motion:
        uint8, ``Motion`` over ground.
    """

    r: Floats
    azimuth: Floats
    speed: Floats
    field: NDArray[np.complex128]
    motion: NDArray[np.uint8]

    def __getitem__(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> Points:
        return Points(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(frozen=True, slots=True, eq=False)
class Echoes:
    """What one scan measured, sorted by range; (n,) each.

    Attributes
    ----------
    r, azimuth, speed:
        As measured: m, rad, m/s (radial, approaching negative).
    rcs, snr:
        dBm², dB.
    shoulder:
        dB by which the strongest echo beside it (two cells or less) is stronger; 0 where none is.
    shared:
        Whether another direction was heard in the same range and Doppler bin.
    motion:
        As of the strongest reflector in the cell.
    """

    r: Floats
    azimuth: Floats
    speed: Floats
    rcs: Floats
    snr: Floats
    shoulder: Floats
    shared: NDArray[np.bool_]
    motion: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.r)

    def __getitem__(self, which: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Echoes:
        return Echoes(*(getattr(self, field.name)[which] for field in fields(self)))


def noise_db(beam: Beam, r: Floats, azimuth: Floats) -> Floats:
    """Return the radar cross section that equals the noise, dBm²: the radar equation.

    SNR = RCS − 40 log10(r) + const − antenna loss; doubling r costs 12.04 dB.
    """
    off = np.abs(azimuth) / beam.half_width
    loss = beam.edge_loss_db * off**2 + beam.outside_loss_db * (off > 1)
    quiet = RCS_FLOOR - DETECTION_DB
    result: Floats = quiet + 40 * np.log10(np.maximum(r, 0.2) / beam.reach) + loss
    return result


def measure(points: Points, beam: Beam, sensor: RadarSensor, rng: np.random.Generator) -> Echoes:
    """Return what ``beam`` detects of ``points``, with the sensor's resolution and accuracy."""
    inside = np.abs(points.azimuth) < beam.half_width + beam.fringe
    inside &= (points.r > beam.range_min) & (points.r < beam.range_max)
    cells = _resolve(points[inside], beam, sensor)
    noise = noise_db(beam, cells.r, cells.azimuth)
    disturbed = cells.field + 10 ** (noise / 20) * _complex_normal(rng, len(cells.r))
    power = np.maximum(np.abs(disturbed) ** 2, 1e-12)
    rcs = 10 * np.log10(power)
    snr = rcs - noise
    floor = RCS_FLOOR - 0.25 + rng.exponential(0.6, len(rcs))
    seen = (snr > DETECTION_DB) & (rcs > floor)
    cells, rcs, snr = cells[seen], rcs[seen], snr[seen]
    order = np.argsort(cells.r, kind="stable")
    cells, rcs, snr = cells[order], rcs[order], snr[order]
    keep, shoulder, shared = _suppress(cells, rcs, beam)
    cells, rcs, snr = cells[keep], rcs[keep], snr[keep]
    blur = 10 ** ((20.0 - snr) / 20)
    n = len(rcs)
    r = cells.r + 0.5 * sensor.range_std(cells.r) * np.hypot(0.5, blur) * rng.normal(size=n)
    spread = sensor.azimuth_std(np.full(n, 200.0 if beam.far else 20.0), cells.azimuth)
    azimuth = cells.azimuth + 0.3 * spread * np.hypot(0.5, blur) * rng.normal(size=n)
    wobble = _WOBBLE * rng.standard_t(3, n)
    speed = cells.speed + sensor.velocity_std * blur * rng.normal(size=n) + wobble
    order = np.argsort(r, kind="stable")
    return Echoes(r, azimuth, speed, rcs, snr, shoulder[keep], shared[keep], cells.motion)[order]


def _complex_normal(rng: np.random.Generator, n: int) -> NDArray[np.complex128]:
    """Return circular complex Gaussian numbers of unit power."""
    pair = rng.normal(0, np.sqrt(0.5), (2, n))
    result: NDArray[np.complex128] = pair[0] + 1j * pair[1]
    return result


def _resolve(points: Points, beam: Beam, sensor: RadarSensor) -> Points:
    """Return one point a resolution cell: fields add up, the place is weighted by power."""
    where = np.full(len(points.r), 200.0 if beam.far else 20.0)
    width = sensor.azimuth_resolution(where, points.azimuth)
    bins = (
        np.floor(points.r / float(sensor.range_resolution(where[:1])[0])),
        np.floor(points.speed / float(sensor.velocity_resolution(where[:1])[0])) + 2048,
        np.floor(points.azimuth / width) + 512,
    )
    key = (bins[0] * 4096 + bins[1]) * 1024 + bins[2]
    order = np.argsort(key, kind="stable")
    points, key = points[order], key[order]
    first = np.flatnonzero(np.append(True, key[1:] != key[:-1])) if len(key) else order
    if len(first) == 0:
        return points
    weight = np.abs(points.field) ** 2 + 1e-12
    total = np.add.reduceat(weight, first)
    r, az, v = (
        np.add.reduceat(weight * value, first) / total
        for value in (points.r, points.azimuth, points.speed)
    )
    field = np.add.reduceat(points.field, first)
    group = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(key))))
    loudest = first.copy()
    by_weight = np.argsort(weight, kind="stable")
    loudest[group[by_weight]] = by_weight
    return Points(r, az, v, field, points.motion[loudest])


def _suppress(
    cells: Points, rcs: Floats, beam: Beam
) -> tuple[NDArray[np.bool_], Floats, NDArray[np.bool_]]:
    """Return which cells are reported, their shoulders (dB), and which share a range-Doppler bin.

    A bin gives one echo; a second one of another direction only where it is nearly as strong.
    ``cells`` are sorted by range, so only a few next ones can be near.
    """
    n = len(rcs)
    bin_m = 1.9 if beam.far else 0.75
    covered, shared, shoulder = np.zeros(n, bool), np.zeros(n, bool), np.zeros(n)
    for step in range(1, n):
        one, other = slice(0, n - step), slice(step, n)
        gap = cells.r[other] - cells.r[one]
        if gap.min() > 2 * bin_m:
            break
        alike = (np.abs(cells.speed[other] - cells.speed[one]) < 0.14) & (gap < 2 * bin_m)
        apart = np.abs(cells.azimuth[other] - cells.azimuth[one]) > np.radians(3.5)
        same_bin = alike & (gap < bin_m)
        margin = np.where(apart, 3.0, 0.8)
        stronger = rcs[other] - rcs[one]
        for mine, excess in ((one, stronger), (other, -stronger)):
            covered[mine] |= same_bin & (excess > margin)
            shared[mine] |= same_bin & apart
            beside = np.where(alike & ~apart, excess, 0.0)
            shoulder[mine] = np.maximum(shoulder[mine], beside)
    return ~covered, shoulder, shared
