"""What one scan tells by how many drives were learned from: never by its own half of a drive."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.estimate.radar_window import FOLLOWS
from models.evaluate.radar import Drive, simulated_drive
from models.training.radar_learned import GAP, halved, learned, taught_by
from models.training.radar_scans import SIMULATED, Amounts, Samples, make_samples

AMOUNTS = Amounts(repeats=1, joined=6, worlds=1, sparse=5)


class Blind:
    """Answers that every level is equally likely, but 30 % a little more."""

    kinds: tuple[str, ...] = RADAR_KINDS

    def run_each(self, inputs: Mapping[str, NDArray[np.float32]]) -> list[Estimate]:
        level = np.where(LEVELS == 30.0, 0.2, 0.08)
        kinds = dict.fromkeys(self.kinds, 1 / len(self.kinds))
        return [Estimate(level, kinds) for _ in inputs["window"]]


@pytest.fixture(scope="module")
def drives() -> list[Drive]:
    return [simulated_drive(2**31 + 3200 + k, 20, GAP + 3) for k in range(3)]


def test_halves_are_apart(drives: list[Drive]) -> None:
    first, second = halved(drives[0])
    assert second.scans[0].sequence - first.scans[-1].sequence == GAP + 1
    assert len(first.scans) + len(second.scans) + GAP == len(drives[0].scans)


def test_what_learned_from_others_never_saw_the_drive_it_is_measured_on(
    drives: list[Drive],
) -> None:
    known: list[frozenset[int]] = []

    def fit(samples: Samples) -> Blind:
        assert (samples.inputs[:, FOLLOWS] == 0.0).all()
        known.append(frozenset(samples.drives.ravel().tolist()) - {SIMULATED})
        return Blind()

    rows = learned(drives, AMOUNTS, fit, draws=1, seed=0)
    assert [(each.others, each.other_half) for each in rows] == [
        *((count, False) for count in range(3)),
        (2, True),
    ]
    whole = [frozenset({2 * drive, 2 * drive + 1}) for drive in range(3)]
    every = frozenset(range(6))
    assert known[0] == frozenset()
    assert set(known) - {frozenset()} >= {every - drive for drive in whole}
    assert known[-6:] == [every - {half} for half in range(6)]
    assert all(each in whole or len(each) >= 4 for each in known[1:])
    for each in rows:
        assert each.reached[0] == pytest.approx(1 / len(LEVELS), abs=1e-3)
        assert each.spread == [0.0, 0.0]


def test_simulated_scans_are_always_learned_from(drives: list[Drive]) -> None:
    samples = make_samples(drives, AMOUNTS, seed=4)
    taught = taught_by(samples, [1])
    assert set(taught.drives.ravel().tolist()) == {1, SIMULATED}
    assert set(taught_by(samples, []).drives.ravel().tolist()) == {SIMULATED}
