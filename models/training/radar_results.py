"""Measures trained radar networks: each on the recorded drive that its training left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from models.estimate.filter import LevelFilter
from models.estimate.level import RADAR_KINDS
from models.estimate.radar import RadarEstimator
from models.estimate.radar_window import RECENT, WINDOW
from models.evaluate.radar import (
    Answers,
    Drive,
    joined,
    measure,
    measure_together,
    radar_filter,
    simulated_drive,
    step_response,
)
from models.evaluate.radar_bound import with_clean_scan
from models.evaluate.radar_left_out import Learned, LeftOut, LeftOutAnswers, OneDrive
from models.training.radar_card import STEP_LEVEL, Results
from models.training.radar_told import told_count_and_threshold, told_neighbours, told_nothing

Unseen = Sequence[tuple[RadarEstimator, Drive]]
"""Estimators, each with the drive that its training left out."""

_DRAWS = 2
_STEP_SCANS = 12
_BOUND_STEP = 5
"""Of recorded scans and of simulated drives, the bound is that of every fifth."""
_TEST_WORLDS = range(2**31, 2**31 + 60)
"""Worlds that no training draws: its seeds are below."""


def measured(
    unseen: Unseen,
    shipped: RadarEstimator,
    learned: list[Learned],
    *,
    quick: bool,
    seed: int,
) -> Results:
    """Return what the networks reach.

    Parameters
    ----------
    unseen:
        Estimators, each with the recorded drive that its training left out.
    shipped:
        The one trained on all, for simulated drives.
    learned:
        What one scan tells by how many drives were learned from, to be told beside the rest.
    quick:
        Fewer draws and simulated drives.
    """
    draws = 1 if quick else _DRAWS
    drives = [drive for _, drive in unseen]
    worlds = _TEST_WORLDS[:1] if quick else _TEST_WORLDS
    simulated = [simulated_drive(world, 7 * index, 14) for index, world in enumerate(worlds)]
    stepped = [simulated_drive(world, 100, 84) for world in worlds[::4]]
    scans = {
        kind: joined(
            [
                measure(one.estimate, [drive], draws=draws, seed=seed, kind=kind)
                for one, drive in unseen
            ]
        )
        for kind in RADAR_KINDS[1:]
    }
    windows = {kind: _sequences(unseen, None, draws, seed, kind) for kind in RADAR_KINDS[1:]}
    bounds = tuple(
        (
            with_clean_scan(clean, scans=count, draws=1, moves=False, seed=seed),
            with_clean_scan(clean, scans=count, draws=1, moves=True, seed=seed),
        )
        for clean, count in (
            ([Drive(each.name, each.scans[::_BOUND_STEP]) for each in drives], 1),
            (drives, 7),
            (simulated[::_BOUND_STEP], 1),
            (simulated[::_BOUND_STEP], 14),
        )
    )
    return Results(
        kinds=scans,
        windows=windows,
        left_out=LeftOut(
            scan=LeftOutAnswers.of(scans, bounds[0]),
            window=LeftOutAnswers.of(windows, bounds[1]),
            drives=_by_drive(
                drives,
                scans["snr"],
                *(
                    told(drives, seed=seed)
                    for told in (told_nothing, told_neighbours, told_count_and_threshold)
                ),
                bounds[0][0],
            ),
            learned=learned,
            step_errors={
                name: _step_errors(unseen, recent, seed)
                for name, recent in (("with restart", RECENT), ("without", WINDOW))
            },
        ),
        together=_sequences(unseen, radar_filter, draws, seed),
        simulated=measure(shipped.estimate, simulated, draws=1, seed=seed),
        second=measure_together(shipped.follow, simulated, None, scans=14, draws=1, seed=seed),
        filtered_second=measure_together(
            shipped.follow, simulated, radar_filter, scans=14, draws=1, seed=seed
        ),
        bounds=bounds,
        step=step_response(shipped.follow, stepped, radar_filter, level=STEP_LEVEL, seed=seed),
    )


def _by_drive(drives: Sequence[Drive], *answers: Answers) -> list[OneDrive]:
    """Return what one scan of each drive tells, then of all."""
    every = [scan for drive in drives for scan in drive.scans]
    return [
        *(
            OneDrive.of(
                drive.name, drive.scans, *(each.among(each.drives == k) for each in answers)
            )
            for k, drive in enumerate(drives)
        ),
        OneDrive.of("all", every, *answers),
    ]


def _sequences(
    unseen: Unseen,
    make_filter: Callable[[], LevelFilter] | None,
    draws: int,
    seed: int,
    kind: str = "snr",
) -> Answers:
    """Return what each estimator says to sequences of seven scans of its drive."""
    return joined(
        [
            measure_together(
                one.follow, [drive], make_filter, scans=7, draws=draws, seed=seed, kind=kind
            )
            for one, drive in unseen
        ]
    )


def _step_errors(unseen: Unseen, recent: int, seed: int) -> list[float]:
    """Return the mean error of the filtered level before and after a step up or down, by scan.

    Points of level, at as many scans before the step in a drive's middle as after it.
    """
    errors = []
    for one, drive in unseen:
        half = len(drive.scans) // 2
        for before, after in ((0.0, STEP_LEVEL), (STEP_LEVEL, 0.0)):
            levels = step_response(
                partial(one.follow, recent),
                [drive],
                radar_filter,
                before=before,
                level=after,
                seed=seed,
            )[0]
            truth = np.where(np.arange(len(levels)) < half, before, after)
            errors.append(np.abs(levels - truth)[half - _STEP_SCANS : half + _STEP_SCANS])
    return [round(float(error), 2) for error in np.mean(errors, axis=0)]
