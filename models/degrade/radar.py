"""Radar degradations: a loss of signal-to-noise ratio, whole (``snr``) or by its effects.

=======  ================================================================================
kind     what it does; N = level / 100, the signal-to-noise ratio falls by N × snr_drop_db
=======  ================================================================================
missed   clusters whose echo falls under the detection threshold vanish (radar equation)
jitter   range, azimuth and radial velocity scatter more (Cramér–Rao bound)
ghosts   0 to 4 clusters a scan that are not there
snr      all three, in this order
=======  ================================================================================

What leaves is what the sensor could have sent: values on the CAN grid, near list then far list,
each sorted by range, IDs from 0, no more clusters than a cycle carries.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from drivers.scan import RadarScan
from models.degrade.checks import check_level, check_within
from models.degrade.clusters import Clusters, FloatArray, check_clusters, consistent_quality
from models.degrade.draw import DrawKey
from models.sensor import ARS408, RadarSensor

Quality = Literal["frozen", "consistent"]

KINDS = ("snr", "ghosts", "missed", "jitter")

GHOST_INVALID_STATES = (4, 9, 10, 11, 12)
MAX_GHOSTS = 4

MOST_GROWTH = 1e4
"""Of the spread, at a loss of 80 dB: every direction is as likely, and most ranges are beyond the
grid. More would leave nothing of the azimuth in float64."""

_NEPERS_PER_DB = float(np.log(10.0)) / 10.0
"""Of power."""


@dataclass(frozen=True, slots=True)
class Ghost:
    """One ghost, as fractions that the scan turns into metres.

    Attributes
    ----------
    range_fraction:
        Uniform on (0, 1): from the sensor's minimum to 10 m beyond the farthest cluster.
    azimuth_fraction:
        Uniform on (-1, 1): of the half field of view at that range.
    rcs_fraction:
        ``|N(0, 1/3)|`` clipped to 1: place in the scan's sorted RCS.
    source_fraction:
        Uniform on (0, 1): which cluster lends its velocity, DynProp and quality.
    invalid_state:
        One of ``GHOST_INVALID_STATES``.
    """

    range_fraction: float
    azimuth_fraction: float
    rcs_fraction: float
    source_fraction: float
    invalid_state: int


@dataclass(frozen=True, slots=True)
class RadarDegradation:
    """Drawn parameters of one degradation of one scan.

    Attributes
    ----------
    kind, level:
        One of ``KINDS``, %.
    drop_db:
        Loss of signal-to-noise ratio at this level, dB.
    seed:
        Of the generator of the normal deviates that each cluster takes.
    ghosts:
        The ghosts that appear.
    quality:
        Whether the sensor's quality fields stay or follow the new ratio.
    """

    kind: str
    level: float
    drop_db: float
    seed: int
    ghosts: tuple[Ghost, ...]
    quality: Quality


def draw(
    kind: str,
    level: float,
    key: DrawKey,
    *,
    snr_drop_db: float = 10.0,
    quality: Quality = "frozen",
    ghost_life: int = 1,
) -> RadarDegradation:
    """Draw the parameters of one degradation of one scan.

    Parameters
    ----------
    kind, level, key:
        As for every kind: see ``models.degrade.kinds``.
    snr_drop_db:
        Loss of signal-to-noise ratio at 100 %, dB, 0 to 300.
    quality:
        ``"frozen"``: a cluster keeps the quality that the sensor gave it. ``"consistent"``:
        they follow the new ratio, see ``models.degrade.clusters.consistent_quality``.
    ghost_life:
        For how many scans the same ghosts appear.

    Raises
    ------
    InputError
        If an argument is not one of these.
    """
    check_level(kind, level, KINDS)
    check_within("snr_drop_db", snr_drop_db, 0.0, 300.0, "dB")
    if quality not in ("frozen", "consistent"):
        raise InputError(f"quality {quality!r}", "unknown", "frozen or consistent")
    if ghost_life < 1 or ghost_life % 1:
        raise InputError("ghost_life", f"{ghost_life} scans", "a whole number from 1")
    seed = int(key.generator(f"radar {kind}").bit_generator.random_raw())
    ghosts: tuple[Ghost, ...] = ()
    if kind in ("snr", "ghosts") and level > 0:
        life = DrawKey(key.seed, key.sensor, key.sequence // int(ghost_life))
        ghosts = _draw_ghosts(life.generator(f"radar ghosts of {kind}"))
    return RadarDegradation(kind, level, level / 100 * snr_drop_db, seed, ghosts, quality)


def _draw_ghosts(generator: np.random.Generator) -> tuple[Ghost, ...]:
    count = int(generator.integers(0, MAX_GHOSTS, endpoint=True))
    uniform = generator.random((count, 4)).tolist()
    loudness = np.minimum(np.abs(generator.standard_normal(count)) / 3, 1.0).tolist()
    states = len(GHOST_INVALID_STATES)
    return tuple(
        Ghost(along, 2 * across - 1, loud, lend, GHOST_INVALID_STATES[int(state * states)])
        for (along, across, lend, state), loud in zip(uniform, loudness, strict=True)
    )


def apply(
    degradation: RadarDegradation, scan: RadarScan, *, sensor: RadarSensor = ARS408
) -> RadarScan:
    """Return the degraded scan; the input stays as it is. At level 0 it is the scan itself.

    A cluster with a NaN or infinite value is left out and counted in ``frames_lost``.

    Raises
    ------
    InputError
        If the scan is not in cluster mode.
    """
    check_clusters(scan)
    if degradation.level == 0:
        return scan
    kind, drop_db = degradation.kind, degradation.drop_db
    clusters = Clusters(scan, sensor)
    deviates = np.random.Generator(np.random.SFC64(degradation.seed)).standard_normal
    if kind in ("snr", "missed"):
        _miss(clusters, degradation.level, drop_db, deviates(len(clusters)))
    if kind in ("snr", "jitter"):
        growth = min(float(std_growth(drop_db)), MOST_GROWTH)
        jitter(clusters, growth, deviates((3, len(clusters))))
    if degradation.ghosts and len(clusters):
        _add_ghosts(clusters, degradation.ghosts)
    sent = clusters.sent()
    if degradation.quality == "consistent":
        return consistent_quality(sent, drop_db, sensor)
    return sent


def echo_db(range_m: FloatArray, rcs: FloatArray, sensor: RadarSensor = ARS408) -> FloatArray:
    """Return the echo's relative power RCS − 40 log10(range), dB (radar equation).

    Parameters
    ----------
    range_m:
        m, clamped at the sensor's minimum.
    rcs:
        dBm².
    """
    return np.asarray(rcs - 40.0 * np.log10(np.maximum(range_m, sensor.range_min_m)))


def threshold_db(echoes_db: FloatArray, sensor: RadarSensor = ARS408) -> float:
    """Return the relative echo power under which the sensor detects nothing, dB.

    The weakest cluster was detected, so the threshold is at most its echo; and a scan of strong
    echoes only says nothing of the threshold, so it is at most the sensor's typical one.
    """
    return float(echoes_db.min(initial=sensor.detection_floor_db))


def is_missed(
    margin_db: FloatArray,
    level: float | FloatArray,
    drop_db: float | FloatArray,
    deviates: FloatArray,
) -> NDArray[np.bool_]:
    """Return which clusters fall under the threshold.

    In units of the threshold: echo × 10^(-drop/10) + w < 1 with w ~ N(0, std = N), so that
    P(missed) = Φ((1 - 10^((margin - drop)/10)) / N).

    Parameters
    ----------
    margin_db:
        Echo over the threshold before the loss, dB.
    level:
        %.
    drop_db:
        Loss, dB.
    deviates:
        Standard normal, one a cluster.
    """
    remaining = echo_over_threshold(margin_db, drop_db)
    return np.asarray(remaining + level * 0.01 * deviates < 1.0)


def echo_over_threshold(margin_db: FloatArray, drop_db: float | FloatArray) -> FloatArray:
    """Return 10^((margin - drop)/10), the echo that is left in units of the threshold."""
    over = np.minimum(margin_db - drop_db, 3000.0)
    return np.asarray(np.exp(over * _NEPERS_PER_DB))


def std_growth(drop_db: float | FloatArray) -> FloatArray:
    """Return √(10^(drop/10) - 1): the added std over the sensor's own (Cramér–Rao).

    The measurement's variance grows as 1 / SNR; only what it gains is added. A gain of SNR
    (negative drop) adds nothing.
    """
    gained = np.expm1(np.maximum(drop_db, 0.0) * _NEPERS_PER_DB)
    return np.asarray(np.sqrt(gained), np.float64)


def _miss(clusters: Clusters, level: float, drop_db: float, deviates: FloatArray) -> None:
    echoes = echo_db(clusters.range, clusters.rows[4], clusters.sensor)
    margin = echoes - threshold_db(echoes, clusters.sensor)
    clusters.keep(~is_missed(margin, level, drop_db, deviates))


def jitter(clusters: Clusters, growth: float | FloatArray, deviates: FloatArray) -> None:
    """Scatter range, azimuth and radial velocity by ``growth`` times the sensor's accuracy.

    Parameters
    ----------
    clusters:
        Changed in place.
    growth:
        One for all or one a cluster.
    deviates:
        (3, n) standard normal.
    """
    sensor, distance, azimuth = clusters.sensor, clusters.range, clusters.azimuth
    faster = growth * sensor.velocity_std * deviates[2] / np.maximum(distance, sensor.range_min_m)
    velocity = clusters.rows[2:4]
    velocity += faster * clusters.rows[:2]
    moved = distance + growth * sensor.range_std(distance) * deviates[0]
    turned = azimuth + growth * sensor.azimuth_std(distance, azimuth) * deviates[1]
    clusters.move(np.maximum(moved, sensor.range_min_m), turned)


def _add_ghosts(clusters: Clusters, ghosts: tuple[Ghost, ...]) -> None:
    sensor, real = clusters.sensor, len(clusters)
    reach = float(clusters.range.max()) + 10.0 - sensor.range_min_m
    lenders = [int(ghost.source_fraction * real) for ghost in ghosts]
    places = [round(ghost.rcs_fraction * (real - 1)) for ghost in ghosts]
    speeds = clusters.rows[2:4].take(lenders, axis=1).T.tolist()
    loudness = np.sort(clusters.rows[4]).take(places).tolist()
    rows = []
    for ghost, (vx, vy), rcs in zip(ghosts, speeds, loudness, strict=True):
        distance = sensor.range_min_m + ghost.range_fraction * reach
        azimuth = ghost.azimuth_fraction * sensor.ghost_azimuth(distance)
        x, y = math.cos(azimuth), math.sin(azimuth)
        radial = vx * x + vy * y
        rows.append((distance * x, distance * y, radial * x, radial * y, rcs))
    states = [ghost.invalid_state for ghost in ghosts]
    clusters.add(np.array(rows).T, np.array(lenders), states)
