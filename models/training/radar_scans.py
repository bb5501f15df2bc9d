"""Training samples of the radar's network: clean scans, recombined, degraded as the product does.

There are few recorded drives, and the scans of one are alike. Halves of two scans joined at a
random bearing make new scenery: one half is turned to the ego motion of the other, so that its
velocities still agree, and the cap on clusters cuts off the farthest, as in the sensor.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.degrade.radar import KINDS
from models.estimate.level import LEVELS, RADAR_KINDS
from models.estimate.radar_features import ego_motion, features
from models.evaluate.radar import Drive, degraded, simulated_drive
from models.sensor import ARS408

SIMULATED = -1
"""Stands for the drive of a simulated scan, which is left out of no fold."""

_BEARING_STD = 25.0
_RCS_STD = 1.5
_FEWEST = 8
_SPARSE = 40
_CYCLES_PER_WORLD = 400
_SHARE_WITH_QUALITY = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Training samples.

    Attributes
    ----------
    features:
        (n, features) float32.
    levels:
        Index into ``LEVELS``, (n,).
    kinds:
        Index into ``RADAR_KINDS``, (n,).
    drives:
        The one or two drives that each comes from, (n, 2), by index, or ``SIMULATED``.
    """

    features: NDArray[np.float32]
    levels: NDArray[np.int64]
    kinds: NDArray[np.int64]
    drives: NDArray[np.int64]

    def without(self, drive: int) -> Samples:
        """Return the samples that have nothing of a drive."""
        rest = (self.drives != drive).all(axis=1)
        return Samples(self.features[rest], self.levels[rest], self.kinds[rest], self.drives[rest])


@dataclass(frozen=True, slots=True)
class Amounts:
    """How many clean scans of each sort to degrade.

    Attributes
    ----------
    repeats:
        Times that every recorded scan is taken.
    joined:
        Scans joined of two recorded ones.
    worlds, per_world:
        Simulated drives, and scans of each.
    sparse:
        Recorded scans of which one to forty clusters are left, so that a scan of few clusters is
        known to say little.
    """

    repeats: int
    joined: int
    worlds: int
    per_world: int
    sparse: int


def make_samples(drives: Sequence[Drive], amounts: Amounts, *, seed: int) -> Samples:
    """Return every clean scan degraded at all levels, and once by each part of ``snr`` alone."""
    rows, levels, kinds, origins = [], [], [], []
    rng = np.random.default_rng(seed)
    for number, (scan, origin) in enumerate(_clean_scans(drives, amounts, rng)):
        tasks = [("snr", float(level)) for level in LEVELS]
        tasks += [(kind, float(rng.choice(LEVELS))) for kind in KINDS if kind != "snr"]
        for kind, level in tasks:
            rows.append(features(degraded(scan, kind, level, seed + number)))
            levels.append(int(np.searchsorted(LEVELS, level)))
            kinds.append(RADAR_KINDS.index(kind if level else "clean"))
            origins.append(origin)
    return Samples(np.array(rows), np.array(levels), np.array(kinds), np.array(origins))


def _clean_scans(
    drives: Sequence[Drive], amounts: Amounts, rng: np.random.Generator
) -> Iterator[tuple[RadarScan, tuple[int, int]]]:
    for index, drive in enumerate(drives):
        for scan in drive.scans * amounts.repeats:
            yield scan, (index, index)
    for _ in range(amounts.joined):
        first, second = rng.integers(len(drives), size=2)
        scans = [drives[index].scans for index in (first, second)]
        pair = [some[rng.integers(len(some))] for some in scans]
        yield join(pair[0], pair[1], rng), (int(first), int(second))
    for _ in range(amounts.sparse):
        index = int(rng.integers(len(drives)))
        scan = drives[index].scans[rng.integers(len(drives[index].scans))]
        few = rng.permutation(len(scan))[: rng.integers(1, _SPARSE, endpoint=True)]
        yield _chosen(scan, np.sort(few)), (index, index)
    for _ in range(amounts.worlds):
        world, quality = int(rng.integers(2**31)), bool(rng.random() < _SHARE_WITH_QUALITY)
        for cycle in rng.choice(_CYCLES_PER_WORLD, amounts.per_world, replace=False):
            scan = simulated_drive(world, int(cycle), 1, quality=quality).scans[0]
            if len(scan):
                yield scan, (SIMULATED, SIMULATED)


def join(left: RadarScan, right: RadarScan, rng: np.random.Generator) -> RadarScan:
    """Return one scan of what two show on either side of a random bearing.

    Either may be mirrored first, and the RCS of all moves by a common amount. If less than eight
    clusters are left, the first scan is returned as it is.
    """
    left, right = (_mirrored(scan) if rng.random() < 0.5 else scan for scan in (left, right))
    bearing = np.radians(rng.normal(0.0, _BEARING_STD))
    ours = np.arctan2(left.y, left.x) > bearing
    theirs = np.arctan2(right.y, right.x) <= bearing
    rows, others = _rows(left), _rows(right)
    here = ego_motion(rows[:2], rows[2:4], left.dyn_prop).velocity(others[:2])
    there = ego_motion(others[:2], others[2:4], right.dyn_prop).velocity(others[:2])
    others[2:4] += here - there
    rows = np.hstack([rows[:, ours], others[:, theirs]])
    rows[4] += rng.normal(0.0, _RCS_STD)
    dyn_prop = np.concatenate([left.dyn_prop[ours], right.dyn_prop[theirs]])
    kept = np.argsort(np.hypot(rows[0], rows[1]))[: ARS408.max_clusters_with_quality]
    if len(kept) < _FEWEST:
        return left
    x, y, vx, vy, rcs = ARS408.rows_to_grid(rows[:, kept]).astype(np.float32)
    return replace(
        left,
        near=len(kept),
        far=0,
        id=np.arange(len(kept), dtype=np.uint8),
        x=x,
        y=y,
        vx=vx,
        vy=vy,
        rcs=rcs,
        dyn_prop=dyn_prop[kept],
    )


def _chosen(scan: RadarScan, index: NDArray[np.intp]) -> RadarScan:
    columns: dict[str, Any] = {name: values[index] for name, values in scan.arrays().items()}
    columns["id"] = np.arange(len(index), dtype=np.uint8)
    return replace(scan, near=len(index), far=0, **columns)


def _rows(scan: RadarScan) -> NDArray[np.float64]:
    return np.array([scan.x, scan.y, scan.vx, scan.vy, scan.rcs], np.float64)


def _mirrored(scan: RadarScan) -> RadarScan:
    return replace(scan, y=-scan.y, vy=-scan.vy)
