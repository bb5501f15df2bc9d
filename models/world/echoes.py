"""From point reflectors to measured echoes: noise, resolution, detection, accuracy."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from models.sensor import RadarSensor
from models.world.beam import DETECTION_DB, NOMINAL_DB, RCS_FLOOR, Beam, noise_db
from models.world.objects import Floats
from models.world.points import Cells, Echoes, Motion, Points

_WOBBLE = 0.03
"""Scale of the radial motion of what stands (leaves, wires) and of Doppler errors, m/s."""

_FALSE_ALARMS = 0.3
"""Peaks of the noise a scan, on average."""

_LUCK_DB = 7.0
"""By how much rivals in one range and Doppler bin gain or lose from scan to scan, dB."""


def measure(points: Points, beam: Beam, sensor: RadarSensor, rng: np.random.Generator) -> Echoes:
    """Return what ``beam`` detects of ``points``, with the sensor's resolution and accuracy."""
    inside = np.abs(points.azimuth) < beam.half_width + beam.fringe
    inside &= (points.r > beam.range_min) & (points.r < beam.range_max)
    cells = _with_false_alarms(_resolve(points[inside], beam, sensor), beam, rng)
    noise = noise_db(beam, cells.r, cells.azimuth)
    disturbed = cells.field + 10 ** (noise / 20) * _complex_normal(rng, len(noise))
    rcs = 20 * np.log10(np.maximum(np.abs(disturbed), 1e-6))
    floor = RCS_FLOOR - 0.25 + rng.exponential(0.6, len(rcs))
    seen = np.flatnonzero((rcs - noise > DETECTION_DB) & (rcs > floor))
    seen = seen[np.argsort(cells.r[seen], kind="stable")]
    cells, rcs, snr = cells[seen], rcs[seen], (rcs - noise)[seen]
    keep, shoulder, rivalry = _suppress(cells, rcs, beam, rng)
    cells, rcs, snr = cells[keep], rcs[keep], snr[keep]
    n = len(rcs)
    typical = np.full(n, beam.typical_m)
    growth = 10 ** ((NOMINAL_DB - snr) / 20)
    spread = np.hypot(0.5, growth)
    lasting = np.sqrt(12) * (np.outer((1013.0, 1523.0), cells.chance) % 1.0 - 0.5)
    r = cells.r + beam.range_bias * lasting[0]
    azimuth = cells.azimuth + beam.azimuth_bias * lasting[1]
    r += beam.range_error * sensor.range_std(typical) * spread * rng.normal(size=n)
    deviates = rng.normal(size=n)
    azimuth += beam.azimuth_error * sensor.azimuth_std(typical, azimuth) * spread * deviates
    speed = cells.speed + sensor.velocity_std * growth * rng.normal(size=n)
    speed += _WOBBLE * rng.standard_t(1.7, n)
    echoes = Echoes(
        r, azimuth, speed, rcs, snr, shoulder[keep], rivalry[keep], cells.motion, cells.chance
    )
    return echoes[np.argsort(r, kind="stable")]


def _complex_normal(rng: np.random.Generator, n: int) -> NDArray[np.complex128]:
    """Return circular complex Gaussian numbers of unit power."""
    pair = rng.normal(0, np.sqrt(0.5), (2, n))
    result: NDArray[np.complex128] = pair[0] + 1j * pair[1]
    return result


def _field(points: Points, beam: Beam) -> NDArray[np.complex128]:
    """Return the complex amplitudes of the points: steady share, speckle, carrier."""
    turn = beam.pitch * points.turn
    steady = beam.calm * points.steady
    loose = np.sqrt((1 - steady) / turn.shape[1])
    real = np.sqrt(steady) + loose * np.cos(turn).sum(axis=1)
    imaginary = loose * np.sin(turn).sum(axis=1)
    carrier = 2 * beam.wave_number * points.r
    wave = np.cos(carrier) - 1j * np.sin(carrier)
    result: NDArray[np.complex128] = points.amplitude * (real + 1j * imaginary) * wave
    return result


def _resolve(points: Points, beam: Beam, sensor: RadarSensor) -> Cells:
    """Return one entry a resolution cell: fields add up, the place is weighted by power."""
    field = _field(points, beam)
    typical = np.full(len(field), beam.typical_m)
    bins = (
        np.floor(points.r / sensor.range_resolution(typical)),
        np.floor(points.speed / sensor.velocity_resolution(typical)) + 2048,
        np.floor(points.azimuth / sensor.azimuth_resolution(typical, points.azimuth)) + 512,
    )
    key = (bins[0] * 4096 + bins[1]) * 1024 + bins[2]
    order = np.argsort(key, kind="stable")
    cells = Cells(points.r, points.azimuth, points.speed, field, points.motion, points.chance)[
        order
    ]
    if len(order) == 0:
        return cells
    new = np.append(True, np.diff(key[order]) > 0)
    first = np.flatnonzero(new)
    weight = np.abs(cells.field) ** 2 + 1e-12
    total = np.add.reduceat(weight, first)
    r, azimuth, speed = (
        np.add.reduceat(weight * value, first) / total
        for value in (cells.r, cells.azimuth, cells.speed)
    )
    by_weight = np.argsort(weight, kind="stable")
    loudest = first.copy()
    loudest[(np.cumsum(new) - 1)[by_weight]] = by_weight
    summed = np.add.reduceat(cells.field, first)
    return Cells(r, azimuth, speed, summed, cells.motion[loudest], cells.chance[loudest])


def _with_false_alarms(cells: Cells, beam: Beam, rng: np.random.Generator) -> Cells:
    """Add peaks of the noise just above the threshold, a few in ten scans, anywhere."""
    n = int(rng.poisson(_FALSE_ALARMS))
    r = beam.range_max * np.sqrt(rng.random(n))
    azimuth = beam.half_width * rng.uniform(-1, 1, n)
    level = noise_db(beam, r, azimuth) + DETECTION_DB + rng.exponential(1.5, n)
    alarms = Cells(
        r,
        azimuth,
        rng.uniform(-30, 15, n),
        (10 ** (level / 20)).astype(complex),
        np.full(n, Motion.MOVING, np.uint8),
        rng.random(n),
    )
    columns = ((getattr(cells, f.name), getattr(alarms, f.name)) for f in fields(Cells))
    return Cells(*(np.concatenate(pair) for pair in columns))


def _suppress(
    cells: Cells, rcs: Floats, beam: Beam, rng: np.random.Generator
) -> tuple[NDArray[np.bool_], Floats, Floats]:
    """Return which cells are reported, their shoulders and their rivalry (dB, see ``Echoes``).

    A range and Doppler bin gives one direction, and of rivals now this one wins, now that; a
    second one is given only where it is nearly as strong. ``cells`` are sorted by range.
    """
    n = len(rcs)
    covered, shoulder, rivalry = np.zeros(n, bool), np.zeros(n), np.full(n, -np.inf)
    luck = rcs + rng.normal(0, _LUCK_DB, n)
    one, other = _neighbours(cells.r, 2 * beam.bin_m)
    alike = np.abs(cells.speed[other] - cells.speed[one]) < 0.14
    one, other = one[alike], other[alike]
    apart = np.abs(cells.azimuth[other] - cells.azimuth[one]) > np.radians(3.5)
    same_bin = cells.r[other] - cells.r[one] < beam.bin_m
    for mine, yours in ((one, other), (other, one)):
        excess = rcs[yours] - rcs[mine]
        beaten = np.where(apart, luck[yours] - luck[mine] > 1.2, excess > 0.8)
        covered[mine[same_bin & beaten]] = True
        np.maximum.at(shoulder, mine[~apart], excess[~apart])
        rival = same_bin & apart
        np.maximum.at(rivalry, mine[rival], excess[rival])
    return ~covered, shoulder, rivalry


def _neighbours(r: Floats, reach: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return all pairs of indices into sorted ranges that are at most ``reach`` apart."""
    count = np.searchsorted(r, r + reach, side="right") - np.arange(len(r)) - 1
    one = np.repeat(np.arange(len(r)), count)
    within = np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
    return one, one + 1 + within
