"""What one scan would tell if the clean scans before and after it were known.

The best test with the very clean scan in hand (``models.evaluate.radar_bound``) knows what nobody
can: which echoes this scan would have had. Here the scenery is known instead, half a second before
and after: boosted trees are told the features of the degraded scan and those of its clean
neighbours, and learn from the other drives what to make of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.estimate.radar_features import features
from models.estimate.radar_view import view
from models.evaluate.radar import Answers, Drive, degraded, gather, joined

try:
    from sklearn.ensemble import HistGradientBoostingClassifier
except ImportError:
    raise MissingExtra("train", "murk train radar") from None

_DRAWS = 4
_KINDS = dict.fromkeys(RADAR_KINDS, 1 / len(RADAR_KINDS))


def told_neighbours(drives: Sequence[Drive], *, seed: int) -> Answers:
    """Return the answers to the scans of each drive, degraded by ``snr``, learned from the others.

    Parameters
    ----------
    drives:
        Two at least, of two scans at least.
    """
    told = [list(_told(drive, seed)) for drive in drives]
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


def _told(drive: Drive, seed: int) -> Iterator[tuple[NDArray[np.float64], int]]:
    """Yield what is told of every scan at every level, and the level's index."""
    clean = [features(view(scan)) for scan in drive.scans]
    for place, scan in enumerate(drive.scans):
        known = np.mean([*clean[max(0, place - 1) : place], *clean[place + 1 : place + 2]], axis=0)
        for draw in range(_DRAWS):
            for level in range(len(LEVELS)):
                noisy = degraded(scan, "snr", float(LEVELS[level]), seed + draw)
                if len(noisy):
                    seen = features(view(noisy))
                    yield np.concatenate([seen, seen - known, known]), level
