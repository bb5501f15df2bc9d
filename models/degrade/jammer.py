"""Other transmitters in the radar's band. N = level / 100.

============  ================================  ===============================================
kind          what it does                      100 %
============  ================================  ===============================================
noise_jam     broadband noise raises the floor  floor 30 dB up in the jammer's direction,
              in a sector                       falling with the beam's pattern to either side
interference  another radar's chirps cross      every second scan is hit: 20 ghosts on one
              this one's: bursts of ghosts      line of sight and a floor 6 dB up
deception     a repeater pulls a target away    60 m farther and 30 m/s faster away after
              in range and velocity             100 scans, then it lets go and starts anew
============  ================================  ===============================================

A jammer stays where it is from scan to scan: its direction belongs to the sensor and the seed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from drivers.scan import RadarScan, RadarState
from models.degrade.checks import check_level
from models.degrade.clusters import Clusters, FloatArray, check_clusters
from models.degrade.draw import DrawKey
from models.degrade.radar import echo_db, is_missed, jitter, std_growth, threshold_db
from models.sensor import ARS408, RadarSensor

KINDS = ("noise_jam", "interference", "deception")

_RADIANS = math.pi / 180
_SECTOR_DB = 30.0
SECTOR_STD_DEG = 10.0
_HIT_SHARE = 0.5
_BURST_DB = 6.0
_BURST_GHOSTS = 20
BURST_SPEED = 30.0
_PULL_M = 60.0
_PULL_SPEED = 30.0
_PULL_SCANS = 100
TARGET_SIZE_M = 3.0


@dataclass(frozen=True, slots=True)
class Jammer:
    """Drawn parameters of one jammer in one scan.

    Attributes
    ----------
    azimuth_deg:
        Where it stands, to the left.
    floor_db:
        How far the noise floor rises, dB.
    ghosts:
        How many ghosts its burst makes.
    pull_m, pull_speed:
        How far the target is pulled away in range, and in radial velocity (m/s).
    seed:
        Of the normal deviates and of the ghosts.
    """

    kind: str
    level: float
    azimuth_deg: float
    floor_db: float
    ghosts: int
    pull_m: float
    pull_speed: float
    seed: int


def draw(kind: str, level: float, key: DrawKey) -> Jammer:
    """Draw the parameters of one jammer in one scan.

    Raises
    ------
    InputError
        If the kind is not one of ``KINDS`` or the level is not 0 to 100 %.
    """
    check_level(kind, level, KINDS)
    N = level / 100
    where = DrawKey(key.seed, key.sensor, 0).generator(f"jammer {kind}").uniform(-40.0, 40.0)
    generator = key.generator(f"jammer {kind} now")
    seed = int(generator.bit_generator.random_raw())
    match kind:
        case "noise_jam":
            return Jammer(kind, level, where, N * _SECTOR_DB, 0, 0.0, 0.0, seed)
        case "interference":
            hit = generator.random() < N * _HIT_SHARE
            ghosts = int(generator.integers(1, _BURST_GHOSTS, endpoint=True)) if hit else 0
            return Jammer(kind, level, where, _BURST_DB if hit else 0.0, ghosts, 0.0, 0.0, seed)
        case _:
            progress = (key.sequence % _PULL_SCANS) / _PULL_SCANS
            pull, speed = N * progress * _PULL_M, N * progress * _PULL_SPEED
            return Jammer(kind, level, where, 0.0, 0, pull, speed, seed)


def apply(jammer: Jammer, scan: RadarScan, *, sensor: RadarSensor = ARS408) -> RadarScan:
    """Return the jammed scan; the input stays as it is. Where nothing is hit it is the scan itself.

    Raises
    ------
    InputError
        If the scan is not in cluster mode.
    """
    check_clusters(scan)
    if jammer.level == 0 or (jammer.floor_db == 0 and jammer.pull_m == 0):
        return scan
    clusters = Clusters(scan, sensor)
    generator = np.random.Generator(np.random.SFC64(jammer.seed))
    if jammer.kind == "deception":
        _pull(jammer, clusters)
    else:
        _raise_floor(clusters, _floor_db(jammer, clusters), generator)
        _burst(jammer, clusters, generator)
    return clusters.sent()


def marked(jammer: Jammer, state: RadarState) -> RadarState:
    """Return the radar's state (0x201) with its interference bit set if the burst hit this scan."""
    if not jammer.ghosts:
        return state
    return replace(state, values=state.values | {"RadarState_Interference": 1.0})


def _floor_db(jammer: Jammer, clusters: Clusters) -> float | FloatArray:
    """Return how far the floor rises toward each cluster: a Gaussian beam in a sector.

    Chirps that cross raise it alike everywhere.
    """
    if jammer.kind == "interference":
        return jammer.floor_db
    away = (np.degrees(clusters.azimuth) - jammer.azimuth_deg) / SECTOR_STD_DEG
    return np.asarray(jammer.floor_db * np.exp(-(away**2) / 2))


def _raise_floor(
    clusters: Clusters, floor_db: float | FloatArray, generator: np.random.Generator
) -> None:
    """Drop what goes under in the noise; what stays scatters more (Cramér–Rao)."""
    echoes = echo_db(clusters.range, clusters.rows[4], clusters.sensor)
    margin = echoes - threshold_db(echoes, clusters.sensor)
    strength = 100 * (1 - 10 ** (-floor_db / 10))
    kept = ~is_missed(margin, strength, floor_db, generator.standard_normal(len(clusters)))
    clusters.keep(kept)
    if isinstance(floor_db, np.ndarray):
        growth: float | FloatArray = std_growth(floor_db[kept])
    else:
        growth = float(std_growth(floor_db))
    jitter(clusters, growth, generator.standard_normal((3, len(clusters))))


def _burst(jammer: Jammer, clusters: Clusters, generator: np.random.Generator) -> None:
    """Add the ghosts of crossing chirps: any range, the other radar's direction, any velocity."""
    if not jammer.ghosts or not len(clusters):
        return
    sensor, real = clusters.sensor, len(clusters)
    uniform = generator.random((4, jammer.ghosts))
    loud, lender = (uniform[2:] * real).astype(np.intp)
    reach = float(clusters.range.max()) + 10.0 - sensor.range_min_m
    distance = sensor.range_min_m + reach * uniform[0]
    near, far = sensor.near_azimuth_resolution_deg[0], sensor.far_azimuth_resolution_deg
    narrow = sensor.far_azimuth_std_deg
    width = np.where(sensor.is_near(distance), narrow + near / 2, narrow + far / 2)
    aim = jammer.azimuth_deg + width * generator.standard_normal(jammer.ghosts)
    azimuth = aim * _RADIANS
    radial = 2 * BURST_SPEED * (uniform[1] - 0.5)
    sight = np.array([np.cos(azimuth), np.sin(azimuth)])
    rcs = np.sort(clusters.rows[4]).take(loud)
    rows = np.concatenate([distance * sight, radial * sight, rcs[None]])
    clusters.add(rows, lender, 12)


def _pull(jammer: Jammer, clusters: Clusters) -> None:
    """Move the loudest target near the jammer's direction, all its clusters together."""
    if not len(clusters):
        return
    away = np.abs(np.degrees(clusters.azimuth) - jammer.azimuth_deg)
    loudness = clusters.rows[4] - (away / SECTOR_STD_DEG) ** 2
    target = clusters.rows[:2, int(np.argmax(loudness)), None]
    hit = np.hypot(*(clusters.rows[:2] - target)) <= TARGET_SIZE_M
    azimuth = clusters.azimuth
    clusters.rows[2] += hit * jammer.pull_speed * np.cos(azimuth)
    clusters.rows[3] += hit * jammer.pull_speed * np.sin(azimuth)
    clusters.move(clusters.range + hit * jammer.pull_m, azimuth)
