"""Trains the radar's network: ``murk train radar``.

A perceptron on ``radar_features``; it answers in logits over the eleven levels and over the kinds.
What it can do on a drive it has not seen is measured first, by leaving each recorded drive out in
turn; the temperature of its probabilities comes from those answers too. The network that is
written is then trained the same way on all drives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dbc.errors import MissingExtra
from drivers.scan import RadarScan
from models.degrade.radar import KINDS
from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.estimate.network import softmax
from models.estimate.radar import RadarEstimator
from models.estimate.radar_features import FEATURES, VERSION, features
from models.evaluate.radar import (
    Answers,
    Drive,
    Estimator,
    joined,
    measure,
    measure_together,
    radar_filter,
    recorded_drives,
    simulated_drive,
    step_response,
)
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
_EPOCHS = 10
_PEAK_RATE = 3e-3
_WEIGHT_DECAY = 1e-2
_RANKED_WEIGHT = 1.0
_KIND_WEIGHT = 0.3
_PART_WEIGHT = 0.1
"""Of the level of scans degraded by one part of ``snr`` alone: it can often not be known."""
_STANDARD_DEVIATIONS = 4.0
_TAIL = 0.05
_SMALLEST_STD = 0.02

_AMOUNTS = Amounts(repeats=8, joined=3000, worlds=500, per_world=4, sparse=200)
_QUICK_AMOUNTS = Amounts(repeats=1, joined=20, worlds=2, per_world=2, sparse=5)
_QUICK_DRIVES = 2
_QUICK_SCANS = 7
_DRAWS = 2
_TEST_WORLDS = range(2**31, 2**31 + 60)
"""Worlds that no training draws: its seeds are below."""


class Perceptron(torch.nn.Module):
    """Two hidden layers on standardised features; logits of the level divided by a temperature.

    Parameters
    ----------
    mean, std:
        Of the training features, (n,) each.
    """

    mean: Tensor
    std: Tensor
    temperature: Tensor

    def __init__(self, mean: Tensor, std: Tensor) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("std", std)
        self.register_buffer("temperature", torch.ones(()))
        self.layers = torch.nn.Sequential(
            torch.nn.Linear(len(mean), _HIDDEN),
            torch.nn.ReLU(),
            torch.nn.Dropout(_DROPOUT),
            torch.nn.Linear(_HIDDEN, _HIDDEN),
            torch.nn.ReLU(),
            torch.nn.Dropout(_DROPOUT),
            torch.nn.Linear(_HIDDEN, len(LEVELS) + len(RADAR_KINDS)),
        )

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits of level (batch, 11) and of kind (batch, 5)."""
        limit = _STANDARD_DEVIATIONS
        standard = ((features - self.mean) / self.std).clamp(-limit, limit)
        logits = self.layers(standard)
        level, kind = logits[:, : len(LEVELS)], logits[:, len(LEVELS) :]
        return level / self.temperature, kind


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
        folds.append(_fit(samples.without(index), seed))
        report({"trained without": drive.name, "fold": index + 1, "of": len(drives)})
    temperature = _temperature(_single_scans(folds, drives, draws=1, seed=seed))
    network = _fit(samples, seed)
    for each in (*folds, network):
        each.temperature.fill_(temperature)
    export(
        network,
        {"features": torch.zeros(1, FEATURES)},
        output,
        model="radar",
        version=VERSION,
        kinds=RADAR_KINDS,
    )
    results = _results(folds, RadarEstimator(output).estimate, drives, quick=quick, seed=seed)
    parameters = sum(parameter.numel() for parameter in network.parameters())
    write_card(
        output.with_suffix(".md"),
        drives=drives,
        results=results,
        samples=len(samples.levels),
        parameters=parameters,
        temperature=temperature,
        seed=seed,
    )
    return {
        "output": str(output),
        "samples": len(samples.levels),
        "parameters": parameters,
        **results.figures(),
    }


def _fit(samples: Samples, seed: int) -> Perceptron:
    torch.manual_seed(seed)
    features = torch.from_numpy(samples.features)
    levels, kinds = torch.from_numpy(samples.levels), torch.from_numpy(samples.kinds)
    counts = torch.bincount(kinds, minlength=len(RADAR_KINDS)).clamp(min=1)
    kind_weights = len(kinds) / (len(RADAR_KINDS) * counts)
    level_weights = torch.where(kinds > RADAR_KINDS.index("snr"), _PART_WEIGHT, 1.0)
    network = Perceptron(*_location_and_scale(features))
    steps = _EPOCHS * -(-len(features) // _BATCH)
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=_WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, _PEAK_RATE, total_steps=steps)
    for _ in range(_EPOCHS):
        for batch in torch.split(torch.randperm(len(features)), _BATCH):
            level, kind = network(features[batch])
            loss = (level_weights[batch] * _level_loss(level, levels[batch])).mean()
            loss = loss + _KIND_WEIGHT * functional.cross_entropy(kind, kinds[batch], kind_weights)
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
    return network.eval()


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


def answers_of(network: Perceptron) -> Estimator:
    """Return the network as an estimator of scans, without a file."""

    def estimate(scan: RadarScan) -> Estimate:
        with torch.no_grad():
            level, kind = network(torch.from_numpy(features(scan))[None])
        return Estimate(
            probabilities=softmax(level[0].numpy()),
            kind_probabilities=dict(zip(RADAR_KINDS, softmax(kind[0].numpy()), strict=True)),
        )

    return estimate


def _single_scans(
    folds: Sequence[Perceptron], drives: Sequence[Drive], *, draws: int, seed: int
) -> Answers:
    """Return the answers of each fold's network on the drive that it has not seen."""
    return joined(
        [
            measure(answers_of(network), [drive], draws=draws, seed=seed)
            for network, drive in zip(folds, drives, strict=True)
        ]
    )


def _temperature(answers: Answers) -> float:
    """Return the temperature under which the true levels are most likely."""
    truth = np.searchsorted(LEVELS, answers.levels)
    log = np.log(np.maximum(answers.probabilities, 1e-30))

    def loss(temperature: float) -> float:
        scaled = softmax(log / temperature)
        return float(-np.log(scaled[np.arange(len(truth)), truth] + 1e-30).mean())

    return float(min(np.geomspace(0.5, 4.0, 61), key=loss))


def _results(
    folds: Sequence[Perceptron],
    shipped: Estimator,
    drives: Sequence[Drive],
    *,
    quick: bool,
    seed: int,
) -> Results:
    draws = 1 if quick else _DRAWS
    unseen = [answers_of(network) for network in folds]
    pairs = list(zip(unseen, drives, strict=True))
    worlds = _TEST_WORLDS[:1] if quick else _TEST_WORLDS
    simulated = [simulated_drive(world, 7 * index, 14) for index, world in enumerate(worlds)]
    stepped = [simulated_drive(world, 100, 84) for world in worlds[::4]]
    return Results(
        kinds={
            kind: joined(
                [measure(one, [drive], draws=draws, seed=seed, kind=kind) for one, drive in pairs]
            )
            for kind in KINDS
        },
        together=joined(
            [
                measure_together(one, [drive], radar_filter, scans=7, draws=draws, seed=seed)
                for one, drive in pairs
            ]
        ),
        simulated=measure(shipped, simulated, draws=1, seed=seed),
        second=measure_together(shipped, simulated, radar_filter, scans=14, draws=1, seed=seed),
        step=step_response(shipped, stepped, radar_filter, level=STEP_LEVEL, seed=seed),
    )
