"""What one scan would tell if something of the clean scan were known.

The best test with the very clean scan in hand (``models.evaluate.radar_bound``) knows what nobody
can: which echoes this scan would have had. Here less of it is known: nothing; the scenery, by the
clean scans half a second before and after; or two numbers of the very clean scan, how many clusters
it had and its threshold of detection, which its weakest echo tells. Boosted trees are told the
features of the degraded scan and what is known, and learn from the other drives what to make of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from drivers.scan import RadarScan
from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.estimate.radar_features import features
from models.estimate.radar_view import view
from models.evaluate.radar import Answers, Drive, degraded, gather, joined
from models.evaluate.radar_left_out import count_and_threshold

try:
    from sklearn.ensemble import HistGradientBoostingClassifier
except ImportError:
    raise MissingExtra("train", "murk train radar") from None

Floats = NDArray[np.float64]

_DRAWS = 4
_KINDS = dict.fromkeys(RADAR_KINDS, 1 / len(RADAR_KINDS))


def told_nothing(drives: Sequence[Drive], *, seed: int) -> Answers:
    """Return the answers to the scans of each drive, degraded by ``snr``, learned from the others.

    Parameters
    ----------
    drives:
        Two at least, of two scans at least.
    """
    return _answers(drives, lambda scan: np.empty(0), lambda drive, place: np.empty(0), seed)


def told_neighbours(drives: Sequence[Drive], *, seed: int) -> Answers:
    """Return the same where the clean scans before and after are known."""

    def neighbours(drive: Drive, place: int) -> Floats:
        near = [*drive.scans[max(0, place - 1) : place], *drive.scans[place + 1 : place + 2]]
        return np.asarray(np.mean([_features(scan) for scan in near], axis=0))

    return _answers(drives, _features, neighbours, seed)


def told_count_and_threshold(drives: Sequence[Drive], *, seed: int) -> Answers:
    """Return the same where number of clusters and threshold of the clean scan are known."""
    return _answers(
        drives,
        count_and_threshold,
        lambda drive, place: count_and_threshold(drive.scans[place]),
        seed,
    )


def _features(scan: RadarScan) -> Floats:
    return features(view(scan))


def _answers(
    drives: Sequence[Drive],
    seen: Callable[[RadarScan], Floats],
    known: Callable[[Drive, int], Floats],
    seed: int,
) -> Answers:
    """Return the answers of trees that compare what a degraded scan shows with what is known."""
    told = [list(_told(drive, seen, known, seed)) for drive in drives]
    answers = []
    for index, own in enumerate(told):
        columns, levels = zip(*chain(*told[:index], *told[index + 1 :]), strict=True)
        trees = HistGradientBoostingClassifier(
            max_iter=80, learning_rate=0.07, max_leaf_nodes=15, random_state=seed
        )
        trees.fit(np.array(columns), np.array(levels))
        probabilities = trees.predict_proba(np.array([columns for columns, _ in own]))
        answers.append(
            gather(
                [
                    (index, "snr", float(LEVELS[level]), Estimate(answer, _KINDS))
                    for (_, level), answer in zip(own, probabilities, strict=True)
                ]
            )
        )
    return joined(answers)


def _told(
    drive: Drive,
    seen: Callable[[RadarScan], Floats],
    known: Callable[[Drive, int], Floats],
    seed: int,
) -> Iterator[tuple[Floats, int]]:
    """Yield what is told of every scan at every level, and the level's index."""
    for place, scan in enumerate(drive.scans):
        before = known(drive, place)
        for draw in range(_DRAWS):
            for level in range(len(LEVELS)):
                noisy = degraded(scan, "snr", float(LEVELS[level]), seed + draw)
                if len(noisy):
                    compared = seen(noisy) - before
                    yield np.concatenate([_features(noisy), compared, before]), level
