"""How far a set of detections is from the truth: the OSPA distance, in metres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.bev.truth import Truth
from models.world.objects import Floats

CUTOFF_M = 5.0
"""What a miss or a false alarm counts, and the most that a detection can be off."""


def ospa(detections: Floats, truth: Truth, cutoff: float = CUTOFF_M) -> float:
    """Return the OSPA distance of order 1 between detections and truth, m.

    The mean over the larger of the two sets of the distance in the best assignment, where a
    distance counts at most ``cutoff`` and so does each member that is left over (D. Schuhmacher,
    B.-T. Vo, B.-N. Vo, "A consistent metric for performance evaluation of multi-object filters",
    IEEE Transactions on Signal Processing 56, 2008). Detections that the truth ignores, and that
    are no road user's in the best assignment, are left out.

    Parameters
    ----------
    detections:
        (k, 2) places in the camera's frame, m.
    """
    distance = np.hypot(*np.moveaxis(detections[:, None] - truth.places, -1, 0))
    one, other = assign(np.minimum(distance, cutoff))
    found = distance[one, other] < cutoff
    spare = np.ones(len(detections), bool)
    spare[one[found]] = False
    false_alarms = int((spare & ~truth.ignores(detections)).sum())
    matched, asked = int(found.sum()), len(truth.places)
    larger = max(asked, matched + false_alarms)
    if larger == 0:
        return 0.0
    off = float(distance[one[found], other[found]].sum())
    return (off + cutoff * (larger - matched)) / larger


def assign(cost: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of the assignment of least total cost, the smaller side whole.

    The Hungarian method by shortest augmenting paths (R. Jonker, A. Volgenant, "A shortest
    augmenting path algorithm for dense and sparse linear assignment problems", Computing 38, 1987).

    Parameters
    ----------
    cost:
        (n, m), finite.
    """
    if len(cost) > cost.shape[1]:
        columns, rows = assign(cost.T)
        return rows, columns
    n, m = cost.shape
    owner = np.full(m, -1)
    row_price, column_price = np.zeros(n), np.zeros(m)
    for row in range(n):
        reached, done = np.full(m, np.inf), np.zeros(m, bool)
        before = np.full(m, -1)
        current, total, column = row, 0.0, -1
        while current >= 0:
            offer = total + cost[current] - row_price[current] - column_price
            better = ~done & (offer < reached)
            reached[better], before[better] = offer[better], column
            column = int(np.where(done, np.inf, reached).argmin())
            total = float(reached[column])
            done[column] = True
            current = int(owner[column])
        earlier = done & (np.arange(m) != column)
        row_price[row] += total
        row_price[owner[earlier]] += total - reached[earlier]
        column_price[earlier] -= total - reached[earlier]
        while column >= 0:
            previous = int(before[column])
            owner[column] = row if previous < 0 else owner[previous]
            column = previous
    taken = np.flatnonzero(owner >= 0)
    order = np.argsort(owner[taken])
    return owner[taken][order], taken[order]
