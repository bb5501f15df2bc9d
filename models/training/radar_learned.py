"""What one scan would tell a network that had learned from fewer recorded drives, or from its own.

Two questions about the drives that are left out. Do more drives help: the network's perceptron for
a scan alone learns from none to all of the others. And would it help to know the very drive: it
learns from all others and from the other half of the drive that it is measured on, the same street
seen by the same radar, which nobody has in the field. Simulated scans are among all samples, which
are degraded and weighed as for the network that ships; no temperature is fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from models.estimate.radar import RadarEstimator, RadarNetwork
from models.estimate.radar_window import FOLLOWS
from models.evaluate.radar import Answers, Drive, joined, measure
from models.evaluate.radar_left_out import Learned, median_speed
from models.training.radar_scans import SIMULATED, Amounts, Samples, make_samples

GAP = 4
"""Scans between the halves of a drive that belong to neither: two seconds at 2 Hz."""

_CHOICES = 3
"""How often the other drives are chosen, where they are not all."""
_MOVING_M_S = 1.0

Fit = Callable[[Samples], RadarNetwork]
"""Trains a network on samples of scans alone."""


def learned(
    drives: Sequence[Drive], amounts: Amounts, fit: Fit, *, draws: int, seed: int
) -> list[Learned]:
    """Return what one scan tells, by how many drives were learned from.

    Parameters
    ----------
    drives:
        Two at least, of more than ``GAP`` + 1 scans.
    amounts:
        Of the samples; steps are left out, for they take more than a scan.
    fit:
        Trains a network.
    draws:
        Times that every scan is degraded at every level to be measured.
    seed:
        Of the samples, the choice of drives and the degradations.
    """
    halves = [half for drive in drives for half in halved(drive)]
    samples = make_samples(halves, replace(amounts, steps=0), seed=seed)
    samples = samples.among(samples.inputs[:, FOLLOWS] < 0.5)
    moving = np.array([median_speed(drive.scans) > _MOVING_M_S for drive in drives])
    rng = np.random.default_rng(seed)

    @cache
    def network(known: frozenset[int]) -> RadarEstimator:
        return RadarEstimator(fit(taught_by(samples, known)))

    def answers(known: Collection[int], half: int) -> Answers:
        """Return the answers to one half by what has learned from others, all by index."""
        one = network(frozenset(known))
        return measure(one.estimate, [halves[half]], draws=draws, seed=seed)

    def of_others(count: int) -> Answers:
        """Return the answers to every drive by what has learned from some of the others."""
        own = []
        for drive in range(len(drives)):
            others = np.delete(np.arange(len(drives)), drive)
            chosen = rng.choice(others, count, replace=False)
            known = np.concatenate([2 * chosen, 2 * chosen + 1]).tolist()
            own.append(joined([answers(known, half) for half in (2 * drive, 2 * drive + 1)]))
        return joined(own)

    def of_other_half() -> Answers:
        """Return the answers to every drive by what has learned from all but one half of it."""
        every = range(len(halves))
        own = [answers([k for k in every if k != half], half) for half in every]
        return joined([joined(own[first : first + 2]) for first in every[::2]])

    most = len(drives) - 1
    rows = []
    for count in range(most + 1):
        choices = _CHOICES if 0 < count < most else 1
        rows.append(Learned.of(count, False, [of_others(count) for _ in range(choices)], moving))
    return [*rows, Learned.of(most, True, [of_other_half()], moving)]


def halved(drive: Drive) -> tuple[Drive, Drive]:
    """Return the halves of a drive in time, without the ``GAP`` scans between them."""
    middle = len(drive.scans) // 2
    return (
        Drive(drive.name, drive.scans[: middle - GAP // 2]),
        Drive(drive.name, drive.scans[middle + GAP // 2 :]),
    )


def taught_by(samples: Samples, known: Collection[int]) -> Samples:
    """Return the samples of some drives, by index, and all simulated ones."""
    own = np.isin(samples.drives, [*known, SIMULATED])
    return samples.among(np.asarray(own.all(axis=1)))
