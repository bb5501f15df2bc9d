"""Accuracy of a radar estimator on clean scans, degraded at known levels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from drivers.scan import RadarScan
from models.degrade.draw import DrawKey
from models.degrade.kinds import module_of
from models.estimate.filter import LevelFilter, level_filter
from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.sensor import ARS408
from models.world.radar import WorldRadar
from models.world.road import World

Estimator = Callable[[RadarScan], Estimate]

_COLUMNS = ("x", "y", "vx", "vy", "rcs")
_HALF_STEP = (LEVELS[1] - LEVELS[0]) / 2
_NUMBERS = {kind: number for number, kind in enumerate(RADAR_KINDS)}


@dataclass(frozen=True, slots=True)
class Drive:
    """Successive clean scans of one drive.

    Attributes
    ----------
    name:
        Of the recording, or of the simulated world.
    scans:
        In order of time.
    """

    name: str
    scans: tuple[RadarScan, ...]


def radar_filter() -> LevelFilter:
    """Return a new filter with the rates that murk uses for a radar."""
    return level_filter("radar")


def recorded_drives(data: Path) -> list[Drive]:
    """Return the recorded drives of ``data/radar/nuscenes_mini/*.npz``, by name.

    Raises
    ------
    InputError
        If there is none, or a file is not what it should be.
    """
    folder = data / "radar" / "nuscenes_mini"
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise InputError(folder, "has no recorded drives", "expected files *.npz")
    return [Drive(path.stem, tuple(_read(path))) for path in paths]


def _read(path: Path) -> Iterator[RadarScan]:
    try:
        with np.load(path) as archive:
            stamps, offsets = archive["stamp_us"], archive["offsets"]
            columns = dict(zip(archive["fields"].tolist(), archive["points"].T, strict=True))
        dyn_prop = columns["dyn_prop"].astype(np.uint8)
        values = {name: columns[name].astype(np.float32) for name in _COLUMNS}
    except (OSError, KeyError, ValueError) as error:
        raise InputError(path, f"no recorded drive ({error})", "stamp_us, offsets, …") from None
    for sequence, (stamp, first, last) in enumerate(
        zip(stamps, offsets[:-1], offsets[1:], strict=True)
    ):
        yield RadarScan(
            sensor=path.stem,
            sensor_id=0,
            sequence=sequence,
            stamp_ns=int(stamp) * 1000,
            stamp_source="file",
            mode="cluster",
            meas_counter=2 * round((stamp - stamps[0]) * 1e-6 / ARS408.cycle_s) % 65536,
            near=int(last - first),
            far=0,
            id=np.arange(last - first, dtype=np.uint8),
            dyn_prop=dyn_prop[first:last],
            **{name: value[first:last] for name, value in values.items()},
        )


def simulated_drive(seed: int, first: int, count: int, *, quality: bool = True) -> Drive:
    """Return ``count`` successive scans of a simulated drive, from cycle ``first`` on."""
    duration_s = (first + count + 1) * 0.08
    radar = WorldRadar(World(seed, duration_s), quality=quality)
    return Drive(f"world {seed}", tuple(radar.scan(cycle) for cycle in range(first, first + count)))


def degraded(scan: RadarScan, kind: str, level: float, seed: int) -> RadarScan:
    """Return a scan degraded by the default degradation of that kind (10 dB at 100 %)."""
    module = module_of("radar", kind)
    result: RadarScan = module.apply(
        module.draw(kind, level, DrawKey(seed, scan.sensor, scan.sequence)), scan
    )
    return result


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What an estimator answered to n degraded scans, or sequences of scans.

    Attributes
    ----------
    drives:
        Index of the drive, (n,).
    kinds, levels:
        The truth: index into ``RADAR_KINDS`` (−1: of none of them) and level in %, (n,) each.
    probabilities, kind_probabilities:
        The answers, (n, 11) and (n, kinds).
    """

    drives: NDArray[np.intp]
    kinds: NDArray[np.intp]
    levels: NDArray[np.float64]
    probabilities: NDArray[np.float64]
    kind_probabilities: NDArray[np.float64]

    @property
    def hits(self) -> NDArray[np.bool_]:
        """Whether the most probable level is the true one, (n,)."""
        return np.asarray(LEVELS[self.probabilities.argmax(axis=1)] == self.levels)

    @property
    def errors(self) -> NDArray[np.float64]:
        """Distance of the mean level from the true one, points, (n,)."""
        return np.asarray(np.abs(self.probabilities @ LEVELS - self.levels))

    def confusion(self) -> NDArray[np.intp]:
        """Return how often each true level (rows) was taken for each level, (11, 11)."""
        table = np.zeros((len(LEVELS), len(LEVELS)), np.intp)
        np.add.at(table, (np.searchsorted(LEVELS, self.levels), self.probabilities.argmax(1)), 1)
        return table

    def kind_confusion(self) -> NDArray[np.intp]:
        """Return how often each true kind (rows) was taken for each kind, (kinds, kinds)."""
        table = np.zeros((len(RADAR_KINDS), len(RADAR_KINDS)), np.intp)
        known = self.kinds >= 0
        np.add.at(table, (self.kinds[known], self.kind_probabilities[known].argmax(1)), 1)
        return table

    @property
    def stds(self) -> NDArray[np.float64]:
        """Standard deviation of each answer, points, (n,)."""
        apart = LEVELS - (self.probabilities @ LEVELS)[:, np.newaxis]
        return np.asarray(np.sqrt((self.probabilities * apart**2).sum(axis=1)))

    def figures(self) -> dict[str, float]:
        """Return what they amount to.

        ``accuracy``, ``mean_error`` in points, ``log_loss``: mean −log probability of the truth,
        nats; ``std``: mean standard deviation, points; ``within``: share of those whose true level
        is no more than two standard deviations from the mean, or than half a step of the levels.
        """
        true = self.probabilities[np.arange(len(self.levels)), np.searchsorted(LEVELS, self.levels)]
        near = self.errors <= np.maximum(2 * self.stds, _HALF_STEP)
        return {
            "count": len(self.levels),
            "accuracy": float(self.hits.mean()),
            "mean_error": float(self.errors.mean()),
            "log_loss": float(-np.log(np.maximum(true, 1e-300)).mean()),
            "std": float(self.stds.mean()),
            "within": float(near.mean()),
        }

    def by_drive(self) -> dict[int, dict[str, float]]:
        """Return ``figures`` of each drive."""
        return {
            int(drive): self.among(self.drives == drive).figures()
            for drive in np.unique(self.drives)
        }

    def among(self, group: NDArray[np.bool_]) -> Answers:
        """Return the answers that a mask (n,) selects."""
        return Answers(
            self.drives[group],
            self.kinds[group],
            self.levels[group],
            self.probabilities[group],
            self.kind_probabilities[group],
        )


def gather(answers: Sequence[tuple[int, str, float, Estimate]]) -> Answers:
    """Return answers from (drive, kind, level, estimate); level 0 of any kind is clean."""
    drives, kinds, levels, estimates = zip(*answers, strict=True)
    return Answers(
        drives=np.array(drives),
        kinds=np.array(
            [
                _NUMBERS.get(kind if level else "clean", -1)
                for kind, level in zip(kinds, levels, strict=True)
            ]
        ),
        levels=np.array(levels, np.float64),
        probabilities=np.array([estimate.probabilities for estimate in estimates]),
        kind_probabilities=np.array(
            [[estimate.kind_probabilities[kind] for kind in RADAR_KINDS] for estimate in estimates]
        ),
    )


def joined(answers: Sequence[Answers]) -> Answers:
    """Return the answers of several estimators as one; the drive is the place in the sequence."""
    return Answers(
        drives=np.repeat(np.arange(len(answers)), [len(each.levels) for each in answers]),
        kinds=np.concatenate([each.kinds for each in answers]),
        levels=np.concatenate([each.levels for each in answers]),
        probabilities=np.concatenate([each.probabilities for each in answers]),
        kind_probabilities=np.concatenate([each.kind_probabilities for each in answers]),
    )


def measure(
    estimate: Estimator, drives: Sequence[Drive], *, draws: int, seed: int = 0, kind: str = "snr"
) -> Answers:
    """Return what an estimator answers to single scans, each ``draws`` times at every level."""
    return gather(
        [
            (index, kind, float(level), estimate(degraded(scan, kind, level, seed + repeat)))
            for index, drive in enumerate(drives)
            for scan in drive.scans
            for repeat in range(draws)
            for level in LEVELS
        ]
    )


def measure_together(
    follow: Callable[[], Estimator],
    drives: Sequence[Drive],
    make_filter: Callable[[], LevelFilter] | None,
    *,
    scans: int,
    draws: int,
    seed: int = 0,
    kind: str = "snr",
) -> Answers:
    """Return what a window and its filter say after ``scans`` successive scans at one level.

    The sequences follow each other without overlap.

    Parameters
    ----------
    follow:
        Makes an estimator for one sequence of scans; see ``RadarEstimator.follow``.
    make_filter:
        Makes a filter for one sequence; None: the window's own answer counts.
    """
    answers = []
    for index, drive in enumerate(drives):
        for first in range(0, len(drive.scans) - scans + 1, scans):
            for repeat in range(draws):
                for level in LEVELS:
                    levels, estimate = make_filter() if make_filter else None, follow()
                    for scan in drive.scans[first : first + scans]:
                        last = estimate(degraded(scan, kind, level, seed + repeat))
                        if levels:
                            filtered = levels.update(scan.stamp_ns, last.probabilities)
                            last = replace(last, probabilities=filtered)
                    answers.append((index, kind, float(level), last))
    return gather(answers)


def step_response(
    follow: Callable[[], Estimator],
    drives: Sequence[Drive],
    make_filter: Callable[[], LevelFilter],
    *,
    level: float,
    before: float = 0.0,
    seed: int = 0,
) -> NDArray[np.float64]:
    """Return the filtered level, %, of drives: (drives, scans).

    Their first half is degraded by ``snr`` to one level, their second half to another.
    """
    rows = []
    for drive in drives:
        levels, estimate = make_filter(), follow()
        half = len(drive.scans) // 2
        rows.append(
            [
                levels.update(
                    scan.stamp_ns,
                    estimate(
                        degraded(scan, "snr", level if index >= half else before, seed)
                    ).probabilities,
                )
                @ LEVELS
                for index, scan in enumerate(drive.scans)
            ]
        )
    return np.array(rows)
