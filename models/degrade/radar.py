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
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from drivers.scan import RadarScan
from models.degrade.checks import check_level, check_within
from models.degrade.draw import DrawKey
from models.sensor import ARS408, RadarSensor

FloatArray = NDArray[np.float64]
Quality = Literal["frozen", "consistent"]

KINDS = ("snr", "ghosts", "missed", "jitter")

GHOST_INVALID_STATES = (4, 9, 10, 11, 12)
MAX_GHOSTS = 4

_PDH0_BOUNDS = np.array([0.25, 0.5, 0.75, 0.9, 0.99, 0.999, 1.0])
_PDH0_MIDDLES = np.array([1.0, 0.125, 0.375, 0.625, 0.825, 0.945, 0.9945, 0.9995])
_RMS_INDICES_PER_DECADE = 30 / np.log10(2000)
_FIELDS = ("x", "y", "vx", "vy", "rcs")


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
) -> RadarDegradation:
    """Draw the parameters of one degradation of one scan.

    Parameters
    ----------
    kind:
        One of ``KINDS``.
    level:
        0 to 100 %; 0 is the identity.
    key:
        What the draw depends on.
    snr_drop_db:
        Loss of signal-to-noise ratio at 100 %, dB, 0 to 300.
    quality:
        ``"frozen"``: a cluster keeps the quality that the sensor gave it. ``"consistent"``: the
        RMS indices grow by the Cramér–Rao bound, and the false-alarm class by p^(1/loss), the
        law of a Rayleigh noise floor.

    Raises
    ------
    InputError
        If an argument is not one of these.
    """
    check_level(kind, level, KINDS)
    check_within("snr_drop_db", snr_drop_db, 0.0, 300.0, "dB")
    if quality not in ("frozen", "consistent"):
        raise InputError(f"quality {quality!r}", "unknown", "frozen or consistent")
    generator = key.generator(f"radar {kind}")
    seed = int(generator.bit_generator.random_raw())
    ghosts = _draw_ghosts(generator) if kind in ("snr", "ghosts") and level > 0 else ()
    return RadarDegradation(kind, level, level / 100 * snr_drop_db, seed, ghosts, quality)


def _draw_ghosts(generator: np.random.Generator) -> tuple[Ghost, ...]:
    return tuple(
        Ghost(
            range_fraction=generator.random(),
            azimuth_fraction=generator.uniform(-1.0, 1.0),
            rcs_fraction=min(1.0, abs(generator.normal(0.0, 1 / 3))),
            source_fraction=generator.random(),
            invalid_state=int(generator.choice(GHOST_INVALID_STATES)),
        )
        for _ in range(generator.integers(0, MAX_GHOSTS, endpoint=True))
    )


def apply(
    degradation: RadarDegradation, scan: RadarScan, *, sensor: RadarSensor = ARS408
) -> RadarScan:
    """Return the degraded scan; the input stays as it is. At level 0 it is the scan itself.

    A cluster with a NaN or infinite value is left out and counted in ``frames_lost``: nothing
    that a CAN bus carries decodes to one.

    Raises
    ------
    InputError
        If the scan is not in cluster mode.
    """
    if scan.mode != "cluster":
        raise InputError(f"scan of {scan.sensor}", "in object mode", "degrade clusters instead")
    if degradation.level == 0:
        return scan
    return _Clusters(scan, sensor).degraded(degradation)


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
    return min(sensor.detection_floor_db, float(echoes_db.min(initial=np.inf)))


def is_missed(
    margin_db: FloatArray, level: float, drop_db: float, deviates: FloatArray
) -> NDArray[np.bool_]:
    """Return which clusters fall under the threshold.

    In units of the threshold: echo × 10^(-drop/10) + w < 1 with w ~ N(0, std = N), so that
    P(missed) = Φ((1 - 10^((margin - drop)/10)) / N).

    Parameters
    ----------
    margin_db:
        Echo over the threshold before the loss, dB.
    level:
        %, above 0.
    drop_db:
        Loss, dB.
    deviates:
        Standard normal, one a cluster.
    """
    remaining = 10.0 ** (np.clip(margin_db - drop_db, -3000.0, 3000.0) / 10.0)
    return np.asarray(remaining + level / 100.0 * deviates < 1.0)


def std_growth(drop_db: float) -> float:
    """Return √(10^(drop/10) - 1): the added std over the sensor's own (Cramér–Rao).

    The measurement's variance grows as 1 / SNR; only what it gains is added. A gain of SNR
    (negative drop) adds nothing.
    """
    return float(np.sqrt(np.expm1(max(drop_db, 0.0) * np.log(10.0) / 10.0)))


class _Clusters:
    """The clusters of one scan in float64 while they are being degraded."""

    def __init__(self, scan: RadarScan, sensor: RadarSensor) -> None:
        self.scan = scan
        self.sensor = sensor
        self.rows = np.array([scan.x, scan.y, scan.vx, scan.vy, scan.rcs], np.float64)
        """x, y, vx, vy, rcs."""
        self.source = np.arange(len(scan))
        """Cluster of ``scan`` from which each one here comes."""
        self.far = scan.id >= scan.near
        self.invalid_state = scan.invalid_state
        finite = np.isfinite(self.rows)
        self.masked = 0
        if not finite.all():
            usable = np.flatnonzero(finite.all(axis=0))
            self.masked = len(scan) - len(usable)
            self.rows = self.rows.take(usable, axis=1)
            self._take(usable)
        self.range = np.hypot(self.rows[0], self.rows[1])
        self.order = self._order()

    def _order(self) -> FloatArray:
        """Return the range by which the sensor sorted each list.

        It sorts by what it measured, before rounding, so lists on the wire step back by up to a
        cell of the grid. The running maximum keeps that order.
        """
        running: FloatArray = self.range.copy()
        for part in (~self.far, self.far):
            running[part] = np.maximum.accumulate(self.range[part])
        return running

    def degraded(self, degradation: RadarDegradation) -> RadarScan:
        """Return the scan with the effects of the degradation's kind."""
        kind, drop_db = degradation.kind, degradation.drop_db
        deviates = np.random.Generator(np.random.SFC64(degradation.seed)).standard_normal
        if kind in ("snr", "missed"):
            self._miss(degradation.level, drop_db, deviates(len(self.source)))
        if kind in ("snr", "jitter"):
            self._jitter(std_growth(drop_db), deviates((3, len(self.source))))
        if degradation.ghosts and len(self.source):
            self._add_ghosts(degradation.ghosts)
        return self._sent(degradation)

    def _take(self, index: NDArray[np.intp]) -> None:
        self.source, self.far = self.source[index], self.far[index]
        if self.invalid_state is not None:
            self.invalid_state = self.invalid_state[index]

    def _miss(self, level: float, drop_db: float, deviates: FloatArray) -> None:
        echoes = echo_db(self.range, self.rows[4], self.sensor)
        margin = echoes - threshold_db(echoes, self.sensor)
        kept = np.flatnonzero(~is_missed(margin, level, drop_db, deviates))
        self.rows = self.rows.take(kept, axis=1)
        self.range, self.order = self.range[kept], self.order[kept]
        self._take(kept)

    def _jitter(self, growth: float, deviates: FloatArray) -> None:
        azimuth = np.arctan2(self.rows[1], self.rows[0])
        moved = self.range + growth * self.sensor.range_std(self.range) * deviates[0]
        np.maximum(moved, self.sensor.range_min_m, out=moved)
        std = self.sensor.azimuth_std(self.range, azimuth)
        turned = azimuth + growth * std * deviates[1]
        faster = growth * self.sensor.velocity_std * deviates[2]
        self.rows[2] += faster * np.cos(azimuth)
        self.rows[3] += faster * np.sin(azimuth)
        self.rows[0] = moved * np.cos(turned)
        self.rows[1] = moved * np.sin(turned)
        self.order += moved - self.range
        self.range = moved

    def _add_ghosts(self, ghosts: tuple[Ghost, ...]) -> None:
        sensor = self.sensor
        fractions = np.array(
            [
                (g.range_fraction, g.azimuth_fraction, g.rcs_fraction, g.source_fraction)
                for g in ghosts
            ]
        ).T
        reach = float(self.range.max()) + 10.0 - sensor.range_min_m
        distance = sensor.range_min_m + fractions[0] * reach
        azimuth = fractions[1] * sensor.ghost_azimuth(distance)
        real = len(self.source)
        lender = (fractions[3] * real).astype(np.intp)
        x, y = np.cos(azimuth), np.sin(azimuth)
        radial = self.rows[2, lender] * x + self.rows[3, lender] * y
        rcs = np.sort(self.rows[4])[np.rint(fractions[2] * (real - 1)).astype(np.intp)]
        new = np.array([distance * x, distance * y, radial * x, radial * y, rcs])
        far = self._belongs_far(distance)
        self.rows = np.hstack([self.rows, new])
        self.source = np.concatenate([self.source, self.source[lender]])
        self.far = np.concatenate([self.far, far])
        self.range = np.concatenate([self.range, distance])
        self.order = np.concatenate([self.order, distance])
        if self.invalid_state is not None:
            states = np.array([ghost.invalid_state for ghost in ghosts], np.uint8)
            self.invalid_state = np.concatenate([self.invalid_state, states])

    def _belongs_far(self, distance: FloatArray) -> NDArray[np.bool_]:
        """Return which ghosts join the far list: those beyond what the near list reaches."""
        if self.far.all() or not self.far.any():
            return np.full(len(distance), bool(self.far[0]))
        return distance > float(self.range[~self.far].max())

    def _sent(self, degradation: RadarDegradation) -> RadarScan:
        """Return the clusters as the sensor would send them."""
        scan, sensor = self.scan, self.sensor
        with_quality = scan.pdh0 is not None
        limit = sensor.max_clusters_with_quality if with_quality else sensor.max_clusters
        on_grid = sensor.rows_to_grid(self.rows)
        distance = np.hypot(on_grid[0], on_grid[1])
        cell = math.hypot(sensor.grid[0].step, sensor.grid[1].step)
        order = np.minimum(np.maximum(self.order, distance - cell), distance + cell)
        sent = np.lexsort((order, self.far))[:limit]
        self._take(sent)
        values = dict(zip(_FIELDS, on_grid.take(sent, axis=1).astype(np.float32), strict=True))
        taken: dict[str, Any] = {
            name: array[self.source]
            for name, array in scan.arrays().items()
            if name not in values and name != "id"
        }
        if self.invalid_state is not None:
            taken["invalid_state"] = self.invalid_state
        if degradation.quality == "consistent":
            taken |= _consistent_quality(taken, degradation.drop_db, sensor)
        far = int(np.count_nonzero(self.far))
        return replace(
            scan,
            near=len(self.far) - far,
            far=far,
            frames_lost=scan.frames_lost + self.masked,
            id=np.arange(len(self.far), dtype=np.uint8),
            **values,
            **taken,
        )


def _consistent_quality(
    taken: dict[str, NDArray[np.uint8]], drop_db: float, sensor: RadarSensor
) -> dict[str, NDArray[np.uint8]]:
    """Return the quality fields that follow the loss of signal-to-noise ratio.

    The RMS table is logarithmic, so a loss is a shift of its index. A cluster without an estimate
    (all RMS 0, or index 31) keeps it, and so does vy_rms, which the sensor never changes.
    """
    changed: dict[str, NDArray[np.uint8]] = {}
    shift = round(drop_db / 20 * _RMS_INDICES_PER_DECADE)
    for name in ("x_rms", "y_rms", "vx_rms"):
        if name in taken:
            old = taken[name]
            estimated = (old > 0) & (old < 31)
            shifted = np.minimum(old.astype(np.int64) + shift, 30)
            changed[name] = np.where(estimated, shifted, old).astype(np.uint8)
    if "pdh0" in taken:
        classes = np.array(sensor.pdh0_classes, np.uint8)
        likely = _PDH0_MIDDLES ** (10.0 ** (-drop_db / 10.0))
        place = np.searchsorted(_PDH0_BOUNDS[classes[:-1] - 1], likely)
        lookup = np.maximum(classes[place], np.arange(8)).astype(np.uint8)
        lookup[0] = 0
        changed["pdh0"] = lookup[taken["pdh0"]]
    return changed
