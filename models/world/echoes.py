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

_WOBBLE = 0.03
"""Scale of the radial motion of what stands (leaves, wires) and of Doppler errors, m/s."""

_FALSE_ALARMS = 0.3
_NOMINAL_DB = 20.0
_LUCK_DB = 7.0


class Motion(IntEnum):
    """How a reflector moves over ground."""

    STANDING = 0
    MOVING = 1
    CROSSING = 2
    STOPPED = 3
    MIRRORED = 4
    """Not there at all: the wave went to and fro twice."""


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
    typical_m:
        A range at which the sensor's tables hold this scan's values, m.
    bin_m:
        Range within which only the strongest echo of one speed is reported, m.
    wave_number:
        Of its carrier, rad/m.
    pitch:
        By how much its speckle turns faster than the near scan's; the two fade independently.
    calm:
        Factor on the reflectors' steady share.
    range_error, azimuth_error:
        Standard deviation of an echo of ``_NOMINAL_DB``, as a share of the data sheet's accuracy.
    range_bias, azimuth_bias:
        Standard deviation, over reflectors, of where this scan finds a reflector against where
        the near scan does, m and rad; it stays as it is from scan to scan.
    """

    far: bool
    half_width: float
    fringe: float
    range_min: float
    range_max: float
    reach: float
    edge_loss_db: float
    outside_loss_db: float
    typical_m: float
    bin_m: float
    wave_number: float
    pitch: float
    calm: float
    range_error: float
    azimuth_error: float
    range_bias: float
    azimuth_bias: float


NEAR = Beam(
    far=False,
    half_width=np.radians(60.0),
    fringe=np.radians(15.0),
    range_min=0.5,
    range_max=129.7,
    reach=83.0,
    edge_loss_db=10.0,
    outside_loss_db=15.0,
    typical_m=20.0,
    bin_m=0.75,
    wave_number=2 * np.pi / 0.00394,
    pitch=1.0,
    calm=1.0,
    range_error=0.8,
    azimuth_error=0.45,
    range_bias=0.0,
    azimuth_bias=0.0,
)

FAR = Beam(
    far=True,
    half_width=np.radians(9.0),
    fringe=np.radians(4.0),
    range_min=10.0,
    range_max=258.0,
    reach=160.0,
    edge_loss_db=3.0,
    outside_loss_db=0.0,
    typical_m=200.0,
    bin_m=1.9,
    wave_number=2 * np.pi / 0.00391,
    pitch=1.6,
    calm=0.3,
    range_error=1.0,
    azimuth_error=0.8,
    range_bias=0.4,
    azimuth_bias=np.radians(0.45),
)


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """What arrives at the radar from N reflectors, (N,) each unless said.

    Attributes
    ----------
    r, azimuth, speed:
        m, rad, m/s (radial, approaching negative).
    amplitude:
        Square root of the mean radar cross section in m².
    steady:
        Share of the power that does not fluctuate.
    turn:
        (N, waves) phases of the waves that the fluctuating share is made of, rad.
    motion:
        uint8, ``Motion`` over ground.
    chance:
        Unchanging number of the reflector, uniform on [0, 1), by which the sensor judges it.
    """

    r: Floats
    azimuth: Floats
    speed: Floats
    amplitude: Floats
    steady: Floats
    turn: Floats
    motion: NDArray[np.uint8]
    chance: Floats

    def __getitem__(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> Points:
        return Points(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Resolution cells with what came back from each, (n,) each; as ``Points`` where not said.

    Attributes
    ----------
    field:
        complex128, sum over the cell's reflectors, square root of m².
    """

    r: Floats
    azimuth: Floats
    speed: Floats
    field: NDArray[np.complex128]
    motion: NDArray[np.uint8]
    chance: Floats

    def __getitem__(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> Cells:
        return Cells(*(getattr(self, field.name)[which] for field in fields(self)))


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
        dB by which the strongest echo beside it is stronger; 0 where none is.
    rivalry:
        dB by which the strongest echo of another direction in the same range and Doppler bin is
        stronger; −inf where there is none.
    motion, chance:
        As of the strongest reflector in the cell.
    """

    r: Floats
    azimuth: Floats
    speed: Floats
    rcs: Floats
    snr: Floats
    shoulder: Floats
    rivalry: Floats
    motion: NDArray[np.uint8]
    chance: Floats

    def __len__(self) -> int:
        return len(self.r)

    def __getitem__(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> Echoes:
        return Echoes(*(getattr(self, field.name)[which] for field in fields(self)))

    def confirmed_by(self, other: Echoes) -> NDArray[np.bool_]:
        """Return which echoes the other scan has too, within 1.5 m and 2°."""
        gap = np.abs(self.r[:, None] - other.r) / 1.5
        turn = np.abs(self.azimuth[:, None] - other.azimuth) / np.radians(2.0)
        return np.asarray((np.maximum(gap, turn) < 1).any(axis=1))


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
    growth = 10 ** ((_NOMINAL_DB - snr) / 20)
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
