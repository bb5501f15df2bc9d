"""Opponents of the radar's network, trained and measured on the same scans and splits.

Recorded and simulated scans degraded by `snr` at all eleven levels. Each recorded drive is left out
of the training once and measured on; the simulated drives that are measured on are in no training.
All answer one scan at a time:

- paper's network: 18 raw columns a cluster, pointwise convolutions 32-64-128, mean over the
  clusters, 64-32-11, cross entropy. The columns of the quality fields are 0, because the injector
  leaves those fields as they were and they would betray it; Adam at 1e-3 instead of 1e-4, at which
  it learns next to nothing from so few steps.
- ridge on classic features: counts, quantiles of RCS − 40 log r, Doppler flags; the spread of its
  residuals is its distribution.
- gradient-boosted trees on the same features.
- murk's perceptron on the same features.

Then what recorded and simulated scans contribute: murk's network trained on one sort and on both,
with fewer samples than the shipped one, on one scan and on a window (seven recorded scans at 2 Hz,
a simulated second), without a filter in time. Last the same network by the width of its hidden
layers, trained on both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from drivers.scan import RadarScan
from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.estimate.network import softmax
from models.estimate.radar import RadarEstimator
from models.estimate.radar_features import features
from models.estimate.radar_view import view
from models.estimate.radar_window import evidence, inputs
from models.evaluate.radar import (
    Answers,
    Drive,
    Estimator,
    degraded,
    joined,
    measure,
    measure_together,
    recorded_drives,
    simulated_drive,
)
from models.evaluate.report import Point, Result, Table
from models.evaluate.timing import median_us, recordings
from models.sensor import ARS408
from models.world.radar import WorldRadar
from models.world.road import World

try:
    import torch
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.linear_model import RidgeCV
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    from torch import Tensor
    from torch.nn import functional

    from models.training.radar import fit, fit_alone
    from models.training.radar_scans import SIMULATED, Amounts, Samples, make_samples
    from models.training.radar_widths import width_points
except ImportError:
    raise MissingExtra("train", "murk bench opponents") from None

UNIT = "points of level, one recorded scan of a drive left out"
SEED = 0
_WORLDS, _PER_WORLD, _CYCLES = 150, 3, 400
_AMOUNTS = Amounts(repeats=4, joined=0, worlds=60, sparse=0)
_QUICK_AMOUNTS = Amounts(repeats=1, joined=0, worlds=2, sparse=0)
_TEST = range(2**31 + 200, 2**31 + 220)
"""Worlds that no training draws."""
_COLUMNS = 18
_EPOCHS, _BATCH, _RATE = 4, 64, 1e-3
_KINDS = dict.fromkeys(RADAR_KINDS, 1 / len(RADAR_KINDS))

Train = Callable[["Scans"], Estimator]


@dataclass(frozen=True, slots=True, eq=False)
class Scans:
    """Degraded scans.

    Attributes
    ----------
    scans:
        n of them.
    levels:
        Index into ``LEVELS``, (n,).
    drives:
        Index of the drive, or ``SIMULATED``, (n,).
    """

    scans: list[RadarScan]
    levels: NDArray[np.int64]
    drives: NDArray[np.int64]

    def without(self, drive: int) -> Scans:
        """Return the scans of other drives."""
        rest = np.flatnonzero(self.drives != drive)
        return Scans([self.scans[i] for i in rest], self.levels[rest], self.drives[rest])

    def features(self) -> NDArray[np.float64]:
        """Return the features of each, (n, FEATURES)."""
        return np.array([features(view(scan)) for scan in self.scans])


def run(quick: bool) -> Iterator[Result]:
    """Train and measure every opponent; nothing without recorded drives."""
    data = recordings()
    if data is None:
        return
    torch.set_num_threads(1)
    drives = recorded_drives(data)
    if quick:
        drives = [Drive(drive.name, drive.scans[:7]) for drive in drives[:2]]
    worlds = _TEST[:1] if quick else _TEST
    simulated = [simulated_drive(world, 5 * k, 14) for k, world in enumerate(worlds)]
    scans = degraded_scans(drives, worlds=2 if quick else _WORLDS)
    rows = []
    for name, train in OPPONENTS.items():
        folds = [train(scans.without(index)) for index in range(len(drives))]
        recorded = _left_out(folds, drives)
        unseen = measure(folds[0], simulated, draws=1, seed=SEED)
        run_time_us = median_us(partial(folds[0], simulated[0].scans[0]), 20)
        yield Point(name, "one scan", run_time_us, recorded.figures()["mean_error"], UNIT)
        rows.append((name, *_cells(recorded), *_cells(unseen)))
    columns = ("one scan", "recorded, right, %", "mean error", "simulated, right, %", "mean error")
    yield Table("Radar: opponents", columns, tuple(rows))
    samples = make_samples(drives, _QUICK_AMOUNTS if quick else _AMOUNTS, seed=SEED)
    yield _contributions(drives, simulated, samples)
    yield from width_points(samples, simulated, SEED)


def degraded_scans(drives: Sequence[Drive], *, worlds: int) -> Scans:
    """Return all recorded scans and some simulated ones at all levels of ``snr``."""
    clean = [(scan, index) for index, drive in enumerate(drives) for scan in drive.scans]
    rng = np.random.default_rng(SEED)
    for _ in range(worlds):
        radar = WorldRadar(World(int(rng.integers(2**31)), _CYCLES * ARS408.cycle_s + 1))
        cycles = rng.choice(_CYCLES, _PER_WORLD, replace=False)
        clean += [(radar.scan(int(cycle)), SIMULATED) for cycle in cycles]
    scans = [
        degraded(scan, "snr", float(level), SEED + number)
        for number, (scan, _) in enumerate(clean)
        for level in LEVELS
    ]
    seen = np.array([len(scan) > 0 for scan in scans])
    levels = np.tile(np.arange(len(LEVELS)), len(clean))
    origins = np.repeat([index for _, index in clean], len(LEVELS))
    return Scans([scan for scan in scans if len(scan)], levels[seen], origins[seen])


def raw_columns(scan: RadarScan) -> NDArray[np.float32]:
    """Return what the paper's network sees of each cluster, (n, 18).

    x, y, z, DynProp, ID, RCS, velocity, velocity over ground, and eight of quality, which are 0.
    """
    seen = view(scan)
    over_ground = seen.velocity - seen.motion.velocity(seen.position)
    columns = np.zeros((len(scan), _COLUMNS), np.float32)
    columns[:, :2] = seen.position.T
    columns[:, 3] = seen.still
    columns[:, 4] = np.arange(len(scan))
    columns[:, 5] = seen.rcs
    columns[:, 6:8] = seen.velocity.T
    columns[:, 8:10] = over_ground.T
    return columns


class PaperNetwork(torch.nn.Module):
    """The paper's identifier: pointwise layers, the mean over the clusters, dense layers.

    Parameters
    ----------
    mean, std:
        Of the training clusters, (18,) each.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, mean: Tensor, std: Tensor) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("std", std)
        self.points = _layers(_COLUMNS, 32, 64, 128)
        self.whole = torch.nn.Sequential(*_layers(128, 64, 32), torch.nn.Linear(32, len(LEVELS)))

    def forward(self, scans: Sequence[Tensor]) -> Tensor:
        """Return logits (scans, 11) of scans of (n, 18) clusters."""
        count = torch.tensor([len(scan) for scan in scans])
        owner = torch.repeat_interleave(torch.arange(len(scans)), count)
        seen = self.points((torch.cat(list(scans)) - self.mean) / self.std)
        total = torch.zeros(len(scans), seen.shape[1]).index_add(0, owner, seen)
        logits: Tensor = self.whole(total / count[:, None])
        return logits


def _layers(*widths: int) -> torch.nn.Sequential:
    layers: list[torch.nn.Module] = []
    for before, after in pairwise(widths):
        layers += [torch.nn.Linear(before, after), torch.nn.ReLU()]
    return torch.nn.Sequential(*layers)


def _paper(scans: Scans) -> Estimator:
    torch.manual_seed(SEED)
    clusters = [torch.from_numpy(raw_columns(scan)) for scan in scans.scans]
    every = torch.cat(clusters)
    network = PaperNetwork(every.mean(dim=0), every.std(dim=0) + 1e-3)
    optimizer = torch.optim.Adam(network.parameters(), lr=_RATE)
    levels = torch.from_numpy(scans.levels)
    for _ in range(_EPOCHS):
        for batch in torch.split(torch.randperm(len(clusters)), _BATCH):
            logits = network([clusters[i] for i in batch])
            loss = functional.cross_entropy(logits, levels[batch])
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()

    def estimate(scan: RadarScan) -> Estimate:
        with torch.no_grad():
            logits = network([torch.from_numpy(raw_columns(scan))])
        return Estimate(softmax(logits[0].numpy()), _KINDS)

    return estimate


def _ridge(scans: Scans) -> Estimator:
    own = scans.features()
    model = make_pipeline(StandardScaler(), RidgeCV(np.geomspace(1e-2, 1e4, 13)))
    model.fit(own, LEVELS[scans.levels])
    spread = float(np.std(model.predict(own) - LEVELS[scans.levels]))

    def estimate(scan: RadarScan) -> Estimate:
        apart = (LEVELS - model.predict(features(view(scan))[np.newaxis])[0]) / spread
        return Estimate(softmax(-0.5 * apart**2), _KINDS)

    return estimate


def _trees(scans: Scans) -> Estimator:
    model = HistGradientBoostingClassifier(max_iter=60, learning_rate=0.1, random_state=SEED)
    model.fit(scans.features(), scans.levels)

    def estimate(scan: RadarScan) -> Estimate:
        return Estimate(model.predict_proba(features(view(scan))[np.newaxis])[0], _KINDS)

    return estimate


def _perceptron(scans: Scans) -> Estimator:
    own = np.array([inputs([evidence(scan, None)], 1)[0] for scan in scans.scans])
    kinds = np.where(scans.levels > 0, RADAR_KINDS.index("snr"), 0)
    origins = np.stack([scans.drives] * 2, axis=1)
    return RadarEstimator(fit_alone(Samples(own, scans.levels, kinds, origins), SEED)).estimate


OPPONENTS: dict[str, Train] = {
    "paper's network": _paper,
    "ridge": _ridge,
    "boosted trees": _trees,
    "murk's perceptron": _perceptron,
}


def _left_out(folds: Sequence[Estimator], drives: Sequence[Drive]) -> Answers:
    return joined(
        [
            measure(one, [drive], draws=1, seed=SEED)
            for one, drive in zip(folds, drives, strict=True)
        ]
    )


def _contributions(drives: Sequence[Drive], simulated: Sequence[Drive], samples: Samples) -> Table:
    """Return what murk's network reaches by what it was trained on."""
    is_simulated = (samples.drives == SIMULATED).all(axis=1)
    everything = np.ones(len(is_simulated), bool)
    rows = []
    for name, sort in (
        ("recorded", ~is_simulated),
        ("simulated", is_simulated),
        ("both", everything),
    ):
        own = samples.among(sort)
        if name == "simulated":
            folds = [RadarEstimator(fit(own, SEED))] * len(drives)
        else:
            folds = [RadarEstimator(fit(own.without(k), SEED)) for k in range(len(drives))]
        windows = [
            measure_together(one.follow, [drive], None, scans=7, draws=1, seed=SEED)
            for one, drive in zip(folds, drives, strict=True)
        ]
        second = measure_together(folds[0].follow, simulated, None, scans=14, draws=1, seed=SEED)
        alone = _left_out([one.estimate for one in folds], drives)
        rows.append((name, *_cells(alone), *_cells(joined(windows)), *_cells(second)))
    columns = (
        "trained on",
        *("one recorded scan, right, %", "mean error"),
        *("seven recorded, right, %", "mean error"),
        *("simulated second, right, %", "mean error"),
    )
    return Table("Radar: what recorded and simulated scans contribute", columns, tuple(rows))


def _cells(answers: Answers) -> tuple[float, float]:
    figures = answers.figures()
    return 100 * figures["accuracy"], figures["mean_error"]
