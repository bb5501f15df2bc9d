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
from models.estimate.level import LEVELS, RADAR_KINDS
from models.estimate.radar_view import ego_motion
from models.estimate.radar_window import WINDOW, Evidence, evidence, inputs
from models.evaluate.radar import Drive, degraded
from models.sensor import ARS408
from models.world.radar import WorldRadar
from models.world.road import World

SIMULATED = -1
"""Stands for the drive of a simulated scan, which is left out of no fold."""

_BEARING_STD = 25.0
_RCS_STD = 1.5
_FEWEST = 8
_SPARSE = 40
_CYCLES_PER_WORLD = 400
_WORLD_S = 46.0
_SECOND = 14
_STRIDE, _STRIDES = 7, 8
"""Every seventh simulated scan is one of the recorded drives' 2 Hz."""
_SHARE_WITH_QUALITY = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Training samples.

    Attributes
    ----------
    inputs:
        (n, inputs) float32, see ``models.estimate.radar_window``.
    levels:
        Index into ``LEVELS`` of the last scan's, (n,).
    kinds:
        Index into ``RADAR_KINDS``, (n,).
    drives:
        The one or two drives that each comes from, (n, 2), by index, or ``SIMULATED``.
    """

    inputs: NDArray[np.float32]
    levels: NDArray[np.int64]
    kinds: NDArray[np.int64]
    drives: NDArray[np.int64]

    def without(self, drive: int) -> Samples:
        """Return the samples that have nothing of a drive."""
        return self.among((self.drives != drive).all(axis=1))

    def among(self, chosen: NDArray[np.bool_]) -> Samples:
        """Return the samples that a mask (n,) selects."""
        return Samples(
            self.inputs[chosen], self.levels[chosen], self.kinds[chosen], self.drives[chosen]
        )


@dataclass(frozen=True, slots=True)
class Amounts:
    """How much of each sort to degrade.

    Attributes
    ----------
    repeats:
        Times that every recorded drive is taken.
    joined:
        Scans joined of two recorded ones.
    worlds:
        Simulated drives; of each a second of scans, and every seventh scan of four seconds.
    sparse:
        Recorded scans of which one to forty clusters are left, so that a scan of few clusters is
        known to say little.
    steps:
        Sequences with a step of ``snr`` of each clean one that is longer than a scan.
    """

    repeats: int
    joined: int
    worlds: int
    sparse: int
    steps: int = 2


@dataclass(frozen=True, slots=True, eq=False)
class Degraded:
    """Successive degraded scans.

    Attributes
    ----------
    scans:
        In order of time.
    kind:
        Of the degradation.
    levels:
        Of each scan, %.
    origin:
        The one or two drives that they come from, by index, or ``SIMULATED``.
    """

    scans: list[RadarScan]
    kind: str
    levels: list[float]
    origin: tuple[int, int]


def degraded_sequences(
    drives: Sequence[Drive], amounts: Amounts, rng: np.random.Generator, seed: int
) -> Iterator[Degraded]:
    """Yield every clean sequence, degraded in every way.

    At all levels of ``snr``, once by each other kind, and with steps of ``snr``.

    Parameters
    ----------
    rng:
        Chooses and joins the clean scans, and draws levels and steps.
    seed:
        Of the degradations.
    """
    for number, (scans, origin) in enumerate(_clean_sequences(drives, amounts, rng)):
        for kind, course in _courses(len(scans), rng, amounts.steps):
            pairs = zip(scans, course, strict=True)
            sequence = [degraded(scan, kind, level, seed + number) for scan, level in pairs]
            yield Degraded(sequence, kind, course, origin)


def make_samples(drives: Sequence[Drive], amounts: Amounts, *, seed: int) -> Samples:
    """Return samples of every scan of all ``degraded_sequences``.

    A scan is one sample alone, and one with some of those before it if there are any. Simulated
    scans at 2 Hz stand alone only: their echoes are found again where those of recorded ones are
    not, which would teach to expect it.
    """
    rows, levels, kinds, origins = [], [], [], []
    rng = np.random.default_rng(seed)
    for sequence in degraded_sequences(drives, amounts, rng, seed):
        windows = _windows(sequence.scans, rng)
        for own, level in zip(windows, sequence.levels, strict=True):
            rows += own
            levels += [int(np.searchsorted(LEVELS, level))] * len(own)
            kinds += [RADAR_KINDS.index(sequence.kind if level else "clean")] * len(own)
            origins += [sequence.origin] * len(own)
    samples = Samples(np.array(rows), np.array(levels), np.array(kinds), np.array(origins))
    sparse = samples.inputs[:, -1] > 0.0  # spacing longer than the typical one
    return samples.among(~(sparse & (samples.drives == SIMULATED).all(axis=1)))


def _courses(n: int, rng: np.random.Generator, steps: int) -> Iterator[tuple[str, list[float]]]:
    """Yield kinds with the level of each of n scans."""
    for level in LEVELS:
        yield "snr", [float(level)] * n
    for kind in RADAR_KINDS[2:]:
        yield kind, [float(rng.choice(LEVELS))] * n
    for _ in range(steps if n > 1 else 0):
        first = int(rng.integers(1, n))
        before, after = rng.choice(LEVELS, 2)
        yield "snr", [float(before)] * first + [float(after)] * (n - first)


def _windows(
    scans: Sequence[RadarScan], rng: np.random.Generator
) -> Iterator[list[NDArray[np.float32]]]:
    """Yield the inputs from each scan: alone, and with one to all of those before it."""
    known: list[Evidence] = []
    for scan in scans:
        if not len(scan):
            known.clear()
            yield []
            continue
        known.append(evidence(scan, known[-1] if known else None))
        own = [inputs(known[-1:], 1)[0]]
        longest = min(len(known), WINDOW)
        if longest > 1:
            own.append(inputs(known[-longest:], int(rng.integers(2, longest, endpoint=True)))[0])
        yield own


def _clean_sequences(
    drives: Sequence[Drive], amounts: Amounts, rng: np.random.Generator
) -> Iterator[tuple[Sequence[RadarScan], tuple[int, int]]]:
    for index, drive in enumerate(drives):
        for _ in range(amounts.repeats):
            yield drive.scans, (index, index)
    for _ in range(amounts.joined):
        first, second = rng.integers(len(drives), size=2)
        scans = [drives[index].scans for index in (first, second)]
        pair = [some[rng.integers(len(some))] for some in scans]
        yield [join(pair[0], pair[1], rng)], (int(first), int(second))
    for _ in range(amounts.sparse):
        index = int(rng.integers(len(drives)))
        scan = drives[index].scans[rng.integers(len(drives[index].scans))]
        few = rng.permutation(len(scan))[: rng.integers(1, _SPARSE, endpoint=True)]
        yield [_chosen(scan, np.sort(few))], (index, index)
    for _ in range(amounts.worlds):
        world = World(int(rng.integers(2**31)), _WORLD_S)
        radar = WorldRadar(world, quality=bool(rng.random() < _SHARE_WITH_QUALITY))
        for count, stride in ((_SECOND, 1), (_STRIDES, _STRIDE)):
            first = int(rng.integers(_CYCLES_PER_WORLD))
            scans = [radar.scan(first + stride * index) for index in range(count)]
            yield scans, (SIMULATED, SIMULATED)


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
