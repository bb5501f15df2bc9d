"""Between the radar's antenna and the world: other paths, a dirty cover, a bent bracket.

============  ================================  =============================================
kind          what it does; N = level / 100     100 %
============  ================================  =============================================
multipath     mirror images in the guard rail,  every moving cluster whose images are loud
              and echoes that go twice          enough has both
blockage      dirt on the cover attenuates,     20 dB both ways on average, half to twice
              more in some directions           that by direction
misalignment  the radar looks aside             5° to one side
============  ================================  =============================================
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drivers.scan import RadarScan
from models.degrade.checks import check_level
from models.degrade.clusters import Clusters, FloatArray, check_clusters
from models.degrade.draw import DrawKey
from models.degrade.radar import GHOST_INVALID_STATES, echo_db, threshold_db
from models.sensor import ARS408, RadarSensor

KINDS = ("multipath", "blockage", "misalignment")

MIRROR_LOSS_DB = 6.0
"""What a guard rail's two reflections cost."""

BOUNCE_LOSS_DB = 10.0
"""What the second trip between the target and the own car costs."""

_BLOCKED_DB = 20.0
_BENT_DEG = 5.0
_RAIL_NEAREST_M, _RAIL_FARTHEST_M = 2.0, 12.0
_RAIL_FEWEST = 5
_IS_MOVING = np.isin(np.arange(256), (0, 2, 6))
"""By DynProp: moving, oncoming, crossing moving."""


@dataclass(frozen=True, slots=True)
class Propagation:
    """Drawn parameters of one disturbed path in one scan.

    Attributes
    ----------
    share:
        Share of the moving clusters that have images.
    attenuation_db:
        Two-way attenuation on average, dB.
    phase:
        Where the cover is dirtiest, rad.
    turn_deg:
        How far the radar looks aside, to the left.
    seed:
        Of the choice of clusters that have images.
    """

    kind: str
    level: float
    share: float
    attenuation_db: float
    phase: float
    turn_deg: float
    seed: int


def draw(kind: str, level: float, key: DrawKey) -> Propagation:
    """Draw the parameters; those of the cover and the bracket are the same for every scan.

    Raises
    ------
    InputError
        If the kind is not one of ``KINDS`` or the level is not 0 to 100 %.
    """
    check_level(kind, level, KINDS)
    N = level / 100
    lasting = DrawKey(key.seed, key.sensor, 0).generator(f"propagation {kind}")
    phase, side = lasting.uniform(0, 2 * math.pi), 1.0 if lasting.random() < 0.5 else -1.0
    seed = int(key.generator(f"propagation {kind} now").bit_generator.random_raw())
    match kind:
        case "multipath":
            return Propagation(kind, level, N, 0.0, 0.0, 0.0, seed)
        case "blockage":
            return Propagation(kind, level, 0.0, N * _BLOCKED_DB, phase, 0.0, seed)
        case _:
            return Propagation(kind, level, 0.0, 0.0, 0.0, N * _BENT_DEG * side, seed)


def apply(propagation: Propagation, scan: RadarScan, *, sensor: RadarSensor = ARS408) -> RadarScan:
    """Return the scan as received over the disturbed path; the input stays as it is.

    At level 0 it is the scan itself.

    Raises
    ------
    InputError
        If the scan is not in cluster mode.
    """
    check_clusters(scan)
    if propagation.level == 0:
        return scan
    clusters = Clusters(scan, sensor)
    match propagation.kind:
        case "multipath":
            _add_images(propagation, clusters)
        case "blockage":
            _attenuate(propagation, clusters)
        case _:
            _turn(clusters, math.radians(propagation.turn_deg))
    return clusters.sent()


def rail_offset(clusters: Clusters) -> float | None:
    """Return y of the guard rail, m: where most standing clusters line up beside the road.

    None where fewer than five do.
    """
    y = clusters.rows[1]
    away = np.abs(y)
    beside = (away >= _RAIL_NEAREST_M) & (away <= _RAIL_FARTHEST_M)
    candidates = y[beside & ~_IS_MOVING[clusters.scan.dyn_prop[clusters.source]]]
    if not len(candidates):
        return None
    cells = (np.rint(candidates) + _RAIL_FARTHEST_M).astype(np.intp)
    counts = np.bincount(cells)
    fullest = int(counts.argmax())
    if counts[fullest] < _RAIL_FEWEST:
        return None
    line = np.sort(candidates[cells == fullest])
    return float(line[(len(line) - 1) // 2] + line[len(line) // 2]) / 2


def mirrored(rows: FloatArray, offset: float) -> FloatArray:
    """Return the images of clusters in a wall along the road at y = ``offset``, (5, n).

    The image of a point in a plane: as far behind it as the point is before it, its velocity
    mirrored; of that the radar sees what lies along the line of sight to the image.
    """
    x, y, vx, vy, rcs = rows
    image_y = 2 * offset - y
    distance = np.maximum(np.hypot(x, image_y), 1e-9)
    ahead, aside = x / distance, image_y / distance
    radial = vx * ahead - vy * aside
    return np.array([x, image_y, radial * ahead, radial * aside, rcs - MIRROR_LOSS_DB])


def bounced(rows: FloatArray) -> FloatArray:
    """Return the echoes that went twice between target and own car: twice as far and as fast."""
    images = 2 * rows
    images[4] = rows[4] - BOUNCE_LOSS_DB
    return images


def _add_images(propagation: Propagation, clusters: Clusters) -> None:
    if not len(clusters):
        return
    chance = np.random.Generator(np.random.SFC64(propagation.seed)).random(len(clusters))
    moving = _IS_MOVING[clusters.scan.dyn_prop[clusters.source]]
    (source,) = (moving & (chance < propagation.share)).nonzero()
    rows = clusters.rows.take(source, axis=1)
    images, lender = [bounced(rows)], [source]
    offset = rail_offset(clusters)
    if offset is not None:
        (inside,) = (np.abs(rows[1]) < abs(offset)).nonzero()
        images.append(mirrored(rows.take(inside, axis=1), offset))
        lender.append(source[inside])
    found = np.concatenate(images, axis=1)
    (heard,) = _heard(found, clusters).nonzero()
    lenders = np.concatenate(lender)[heard]
    clusters.add(found.take(heard, axis=1), lenders, GHOST_INVALID_STATES[0])


def _heard(rows: FloatArray, clusters: Clusters) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which images are over the threshold and inside the field of view."""
    sensor = clusters.sensor
    threshold = threshold_db(echo_db(clusters.range, clusters.rows[4], sensor), sensor)
    distance, azimuth = np.hypot(rows[0], rows[1]), np.arctan2(rows[1], rows[0])
    seen = sensor.sees_near(distance, azimuth) | sensor.sees_far(distance, azimuth)
    return np.asarray(seen & (echo_db(distance, rows[4], sensor) >= threshold))


def _attenuate(propagation: Propagation, clusters: Clusters) -> None:
    """Weaken every echo by the cover's attenuation toward it; the RCS shows it."""
    unevenness = 2.0 ** np.cos(6 * clusters.azimuth + propagation.phase)
    echoes = echo_db(clusters.range, clusters.rows[4], clusters.sensor)
    threshold = threshold_db(echoes, clusters.sensor)
    loss = propagation.attenuation_db * unevenness
    clusters.rows[4] -= loss
    clusters.keep(echoes - loss >= threshold)


def _turn(clusters: Clusters, angle: float) -> None:
    """Turn the world the other way: the radar does not know that it looks aside."""
    c, s = math.cos(angle), math.sin(angle)
    vx, vy = clusters.rows[2].copy(), clusters.rows[3].copy()
    clusters.rows[2], clusters.rows[3] = c * vx + s * vy, c * vy - s * vx
    clusters.move(clusters.range, clusters.azimuth - angle)
