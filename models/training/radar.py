"""Trains the radar's network: ``murk train radar``.

Perceptrons on ``radar_window`` in one file: some for a scan alone, some for a scan with those
before it. They answer in logits over the eleven levels and over the kinds. What they can do on a
drive they have not seen is measured first, by leaving each recorded drive out in turn; the
temperatures of the probabilities come from those answers too. The network that is written is then
trained the same way on all drives.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from models.degrade.radar import KINDS
from models.estimate.filter import LevelFilter
from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.estimate.network import softmax
from models.estimate.radar import RadarEstimator
from models.estimate.radar_features import FEATURES
from models.estimate.radar_window import FOLLOWS, INPUTS, VERSION
from models.evaluate.radar import (
    Answers,
    Drive,
    joined,
    measure,
    measure_together,
    radar_filter,
    recorded_drives,
    simulated_drive,
    step_response,
)
from models.evaluate.radar_bound import with_clean_scan
from models.training.radar_card import STEP_LEVEL, Results, write_card
from models.training.radar_scans import Amounts, Samples, make_samples

try:
    import torch
    from torch.nn import functional

    from models.training.export import export
except ImportError:
    raise MissingExtra("train", "murk train radar") from None

if TYPE_CHECKING:
    from torch import Tensor

Report = Callable[[dict[str, object]], None]

_HIDDEN = 64
_DROPOUT = 0.2
_BATCH = 512
_EPOCHS = 8
_PEAK_RATE = 3e-3
_WEIGHT_DECAY = 1e-2
_RANKED_WEIGHT = 1.0
_KIND_WEIGHT = 0.3
_PART_WEIGHT = 0.1
"""Of the level of scans degraded by one part of ``snr`` alone: it can often not be known."""
_STANDARD_DEVIATIONS = 4.0
_TAIL = 0.05
_SMALLEST_STD = 0.02

_AMOUNTS = Amounts(repeats=10, joined=3000, worlds=200, sparse=200)
_QUICK_AMOUNTS = Amounts(repeats=1, joined=20, worlds=2, sparse=5)
_QUICK_DRIVES = 2
_QUICK_SCANS = 7
_DRAWS = 2
_BOUND_STEP = 5
"""Of recorded scans and of simulated drives, the bound is that of every fifth."""
_TEST_WORLDS = range(2**31, 2**31 + 60)
"""Worlds that no training draws: its seeds are below."""


class Perceptron(torch.nn.Module):
    """Two hidden layers on standardised inputs; logits of levels, then kinds.

    Parameters
    ----------
    mean, std:
        Of the training inputs, (n,) each; inputs beyond are not read.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, mean: Tensor, std: Tensor) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("std", std)
        self.layers = torch.nn.Sequential(
            torch.nn.Linear(len(mean), _HIDDEN),
            torch.nn.ReLU(),
            torch.nn.Dropout(_DROPOUT),
            torch.nn.Linear(_HIDDEN, _HIDDEN),
            torch.nn.ReLU(),
            torch.nn.Dropout(_DROPOUT),
            torch.nn.Linear(_HIDDEN, len(LEVELS) + len(RADAR_KINDS)),
        )

    def forward(self, inputs: Tensor) -> Tensor:
        """Return logits (batch, 16)."""
        limit = _STANDARD_DEVIATIONS
        standard = ((inputs[:, : len(self.mean)] - self.mean) / self.std).clamp(-limit, limit)
        logits: Tensor = self.layers(standard)
        return logits


class RadarNet(torch.nn.Module):
    """Answers by one perceptron for a scan alone, by another for a scan with others before it.

    Logits of the level are divided by the temperature of that perceptron.
    """

    temperatures: Tensor
    kinds: tuple[str, ...] = RADAR_KINDS

    def __init__(self, alone: Perceptron, follows: Perceptron) -> None:
        super().__init__()
        self.alone = alone
        self.follows = follows
        self.register_buffer("temperatures", torch.ones(2))

    def forward(self, window: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits of level (batch, 11) and of kind (batch, 5)."""
        follows = window[:, FOLLOWS : FOLLOWS + 1] > 0.5
        logits = torch.where(follows, self.follows(window), self.alone(window))
        temperature = torch.where(follows, self.temperatures[1], self.temperatures[0])
        return logits[:, : len(LEVELS)] / temperature, logits[:, len(LEVELS) :]

    def run(self, inputs: Mapping[str, NDArray[np.float32]]) -> Estimate:
        """Return the estimate for one window, as ``models.estimate.network.Network`` does."""
        with torch.no_grad():
            level, kind = self(torch.from_numpy(inputs["window"]))
        return Estimate(
            probabilities=softmax(level[0].numpy()),
            kind_probabilities=dict(zip(RADAR_KINDS, softmax(kind[0].numpy()), strict=True)),
        )


def train(data: Path, output: Path, *, quick: bool, seed: int, report: Report) -> dict[str, object]:
    """Train the radar's network, write it and its card, and return what it reaches.

    Deterministic on one machine: the same data and seed give the same file.

    Parameters
    ----------
    data:
        Folder with ``radar/nuscenes_mini/*.npz``.
    output:
        ONNX file to write; its card goes beside it with the suffix ``.md``.
    quick:
        Two short drives, in seconds: to see that it runs, not to be used.
    seed:
        Of the scans' recombination, the degradations and the network.
    report:
        Called with a record after every network that was trained.

    Returns
    -------
    dict
        ``output``, ``samples``, ``parameters``, and the figures of the card.

    Raises
    ------
    InputError
        If the data lack something.
    """
    torch.set_num_threads(1)
    drives = recorded_drives(data)
    if quick:
        drives = [Drive(drive.name, drive.scans[:_QUICK_SCANS]) for drive in drives[:_QUICK_DRIVES]]
    samples = make_samples(drives, _QUICK_AMOUNTS if quick else _AMOUNTS, seed=seed)
    report({"samples": len(samples.levels)})
    folds = []
    for index, drive in enumerate(drives):
        folds.append(fit(samples.without(index), seed))
        report({"trained without": drive.name, "fold": index + 1, "of": len(drives)})
    alone, follows = _unfiltered(folds, drives, seed=seed)
    temperatures = (_temperature(alone), _temperature(follows))
    network = fit(samples, seed)
    for each in (*folds, network):
        each.temperatures.copy_(torch.tensor(temperatures))
    export(
        network,
        {"window": torch.zeros(1, INPUTS)},
        output,
        model="radar",
        version=VERSION,
        kinds=RADAR_KINDS,
    )
    results = _results(folds, RadarEstimator(output), drives, quick=quick, seed=seed)
    parameters = sum(parameter.numel() for parameter in network.parameters())
    write_card(
        output.with_suffix(".md"),
        drives=drives,
        results=results,
        samples=len(samples.levels),
        parameters=parameters,
        temperatures=temperatures,
        seed=seed,
    )
    return {
        "output": str(output),
        "samples": len(samples.levels),
        "parameters": parameters,
        **results.figures(),
    }


def fit(samples: Samples, seed: int) -> RadarNet:
    """Train a network on samples of scans alone and with scans before them."""
    torch.manual_seed(seed)
    follows = samples.inputs[:, FOLLOWS] > 0.5
    alone, windows = samples.among(~follows), samples.among(follows)
    return RadarNet(_fit(alone, alone.inputs[:, :FEATURES]), _fit(windows, windows.inputs)).eval()


def fit_alone(samples: Samples, seed: int) -> RadarNet:
    """Train a network on samples of scans alone; windows it answers in the same way."""
    torch.manual_seed(seed)
    alone = _fit(samples, samples.inputs[:, :FEATURES])
    return RadarNet(alone, alone).eval()


def _fit(samples: Samples, columns: NDArray[np.float32]) -> Perceptron:
    inputs = torch.from_numpy(np.ascontiguousarray(columns))
    levels, kinds = torch.from_numpy(samples.levels), torch.from_numpy(samples.kinds)
    counts = torch.bincount(kinds, minlength=len(RADAR_KINDS)).clamp(min=1)
    kind_weights = len(kinds) / (len(RADAR_KINDS) * counts)
    level_weights = torch.where(kinds > RADAR_KINDS.index("snr"), _PART_WEIGHT, 1.0)
    network = Perceptron(*_location_and_scale(inputs))
    steps = _EPOCHS * -(-len(inputs) // _BATCH)
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=_WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, _PEAK_RATE, total_steps=steps)
    for _ in range(_EPOCHS):
        for batch in torch.split(torch.randperm(len(inputs)), _BATCH):
            logits = network(inputs[batch])
            level, kind = logits[:, : len(LEVELS)], logits[:, len(LEVELS) :]
            loss = (level_weights[batch] * _level_loss(level, levels[batch])).mean()
            loss = loss + _KIND_WEIGHT * functional.cross_entropy(kind, kinds[batch], kind_weights)
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
    return network


def _location_and_scale(features: Tensor) -> tuple[Tensor, Tensor]:
    """Return mean and std of each feature without its tails, which few clusters alone fill."""
    tails = np.quantile(features.numpy(), (_TAIL, 1.0 - _TAIL), axis=0).astype(np.float32)
    middle = features.clamp(torch.from_numpy(tails[0]), torch.from_numpy(tails[1]))
    return middle.mean(dim=0), middle.std(dim=0) + _SMALLEST_STD


def _level_loss(logits: Tensor, levels: Tensor) -> Tensor:
    """Cross entropy and ranked probability score: to miss by a little is better than by much."""
    truth = functional.one_hot(levels, len(LEVELS)).to(logits.dtype)
    apart = logits.softmax(dim=1).cumsum(dim=1) - truth.cumsum(dim=1)
    ranked = apart.square().sum(dim=1)
    return functional.cross_entropy(logits, levels, reduction="none") + _RANKED_WEIGHT * ranked


def _unfiltered(
    folds: Sequence[RadarNet], drives: Sequence[Drive], *, seed: int
) -> tuple[Answers, Answers]:
    """Return what each fold's network says on the drive that it has not seen.

    First to scans alone, then to windows of seven.
    """
    pairs = [(RadarEstimator(network), drive) for network, drive in zip(folds, drives, strict=True)]
    alone = [measure(one.estimate, [drive], draws=1, seed=seed) for one, drive in pairs]
    return joined(alone), _sequences(pairs, None, 1, seed)


def _temperature(answers: Answers) -> float:
    """Return the temperature under which the true levels are most likely."""
    truth = np.searchsorted(LEVELS, answers.levels)
    log = np.log(np.maximum(answers.probabilities, 1e-30))

    def loss(temperature: float) -> float:
        scaled = softmax(log / temperature)
        return float(-np.log(scaled[np.arange(len(truth)), truth] + 1e-30).mean())

    return float(min(np.geomspace(0.5, 4.0, 61), key=loss))


def _results(
    folds: Sequence[RadarNet],
    shipped: RadarEstimator,
    drives: Sequence[Drive],
    *,
    quick: bool,
    seed: int,
) -> Results:
    draws = 1 if quick else _DRAWS
    unseen = [RadarEstimator(network) for network in folds]
    pairs = list(zip(unseen, drives, strict=True))
    worlds = _TEST_WORLDS[:1] if quick else _TEST_WORLDS
    simulated = [simulated_drive(world, 7 * index, 14) for index, world in enumerate(worlds)]
    stepped = [simulated_drive(world, 100, 84) for world in worlds[::4]]
    return Results(
        kinds={
            kind: joined(
                [
                    measure(one.estimate, [drive], draws=draws, seed=seed, kind=kind)
                    for one, drive in pairs
                ]
            )
            for kind in KINDS
        },
        window=_sequences(pairs, None, draws, seed),
        together=_sequences(pairs, radar_filter, draws, seed),
        simulated=measure(shipped.estimate, simulated, draws=1, seed=seed),
        second=measure_together(shipped.follow, simulated, None, scans=14, draws=1, seed=seed),
        filtered_second=measure_together(
            shipped.follow, simulated, radar_filter, scans=14, draws=1, seed=seed
        ),
        bounds=tuple(
            (
                with_clean_scan(clean, scans=scans, draws=1, moves=False, seed=seed),
                with_clean_scan(clean, scans=scans, draws=1, moves=True, seed=seed),
            )
            for clean, scans in (
                ([Drive(each.name, each.scans[::_BOUND_STEP]) for each in drives], 1),
                (drives, 7),
                (simulated[::_BOUND_STEP], 1),
                (simulated[::_BOUND_STEP], 14),
            )
        ),
        step=step_response(shipped.follow, stepped, radar_filter, level=STEP_LEVEL, seed=seed),
    )


def _sequences(
    pairs: Sequence[tuple[RadarEstimator, Drive]],
    make_filter: Callable[[], LevelFilter] | None,
    draws: int,
    seed: int,
) -> Answers:
    """Return what each estimator says to sequences of seven scans of its drive."""
    return joined(
        [
            measure_together(one.follow, [drive], make_filter, scans=7, draws=draws, seed=seed)
            for one, drive in pairs
        ]
    )
