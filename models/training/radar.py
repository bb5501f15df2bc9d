"""Trains the radar's network: ``murk train radar``.

Perceptrons on ``radar_window`` in one file: some for a scan alone, some for a scan with those
before it. They answer in logits over the eleven levels and over the kinds. What they can do on a
drive they have not seen is measured by leaving each recorded drive out in turn; so is how sure they
may be, see ``models.training.radar_temperature``. The network that is written is trained the same
way on all drives.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.estimate.network import softmax
from models.estimate.radar import RadarEstimator
from models.estimate.radar_features import FEATURES
from models.estimate.radar_window import FOLLOWS, INPUTS, VERSION
from models.evaluate.radar import Drive, recorded_drives
from models.training.radar_card import TEMPERATURES, write_card
from models.training.radar_learned import learned
from models.training.radar_results import measured
from models.training.radar_scans import Amounts, Samples, make_samples

try:
    import torch
    from torch.nn import functional

    from models.training.descend import Report, descend
    from models.training.device import best_device
    from models.training.export import export
    from models.training.radar_temperature import Temperature, temper
except ImportError:
    raise MissingExtra("train", "murk train radar") from None

if TYPE_CHECKING:
    from torch import Tensor

HIDDEN = 64
"""Width of the hidden layers."""

_DROPOUT = 0.2
_BATCH = 512
_EPOCHS = 8
_PEAK_RATE = 3e-3
_WEIGHT_DECAY = 1e-2
_RANKED_WEIGHT = 1.0
_KIND_WEIGHT = 0.3
_LEVEL_WEIGHTS = {
    "clean": 1.0,
    "snr": 1.0,
    "ghosts": 0.06,
    "missed": 0.06,
    "jitter": 0.06,
    "noise_jam": 0.03,
    "interference": 0.03,
    "blockage": 0.03,
}
"""Of the level in the loss, by kind: that of a part of ``snr`` alone can often not be known, and
that of the last three only as far as it shows as a loss."""
_STANDARD_DEVIATIONS = 4.0
_TAIL = 0.05
_SMALLEST_STD = 0.02

_AMOUNTS = Amounts(repeats=10, joined=3000, worlds=200, sparse=200)
_QUICK_AMOUNTS = Amounts(repeats=1, joined=20, worlds=2, sparse=5)
_HELD_OUT = Amounts(repeats=1, joined=0, worlds=40, sparse=0, steps=0)
_QUICK_HELD_OUT = Amounts(repeats=1, joined=0, worlds=2, sparse=0, steps=0)
_QUICK_DRIVES = 2
_QUICK_SCANS = 7


class Perceptron(torch.nn.Module):
    """Two hidden layers on standardised inputs; logits of levels, then kinds.

    Parameters
    ----------
    mean, std:
        Of the training inputs, (n,) each; inputs beyond are not read.
    hidden:
        Width of the hidden layers.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, mean: Tensor, std: Tensor, hidden: int = HIDDEN) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("std", std)
        self.layers = torch.nn.Sequential(
            torch.nn.Linear(len(mean), hidden),
            torch.nn.ReLU(),
            torch.nn.Dropout(_DROPOUT),
            torch.nn.Linear(hidden, hidden),
            torch.nn.ReLU(),
            torch.nn.Dropout(_DROPOUT),
            torch.nn.Linear(hidden, len(LEVELS) + len(RADAR_KINDS)),
        )

    def forward(self, inputs: Tensor) -> Tensor:
        """Return logits (batch, levels + kinds)."""
        limit = _STANDARD_DEVIATIONS
        standard = ((inputs[:, : len(self.mean)] - self.mean) / self.std).clamp(-limit, limit)
        logits: Tensor = self.layers(standard)
        return logits


class RadarNet(torch.nn.Module):
    """Answers by one perceptron for a scan alone, by another for a scan with others before it.

    Logits of the level are divided by a temperature; see ``models.training.radar_temperature``.
    """

    kinds: tuple[str, ...] = RADAR_KINDS

    def __init__(self, alone: Perceptron, follows: Perceptron) -> None:
        super().__init__()
        self.alone = alone
        self.follows = follows
        self.temperature = Temperature()

    def forward(self, window: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits of level (batch, 11) and of kind (batch, 8)."""
        level, kind = self.untempered(window)
        return level / self.temperature(window[:, FOLLOWS:], kind), kind

    def untempered(self, window: Tensor) -> tuple[Tensor, Tensor]:
        """Return the same before the division."""
        follows = window[:, FOLLOWS : FOLLOWS + 1] > 0.5
        logits = torch.where(follows, self.follows(window), self.alone(window))
        return logits[:, : len(LEVELS)], logits[:, len(LEVELS) :]

    def run_each(self, inputs: Mapping[str, NDArray[np.float32]]) -> list[Estimate]:
        """Return the estimate for each window, as ``models.estimate.network.Network`` does."""
        with torch.no_grad():
            level, kind = self(torch.from_numpy(inputs["window"]))
        return [
            Estimate(probabilities, dict(zip(RADAR_KINDS, kind_probabilities, strict=True)))
            for probabilities, kind_probabilities in zip(
                softmax(level.numpy()), softmax(kind.numpy()).tolist(), strict=True
            )
        ]


def train(data: Path, output: Path, *, quick: bool, seed: int, report: Report) -> dict[str, object]:
    """Train the radar's network, write it and its card, and return what it reaches.

    Deterministic on one machine: the same data and seed give the same file.

    Parameters
    ----------
    data:
        Folder with ``radar/nuscenes_mini/*.npz``.
    output:
        ONNX file to write; beside it go its card (``.md``) and what it reaches on recorded drives
        left out (``.json``, see ``models.evaluate.radar_left_out``).
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
    network = fit(samples, seed)
    held_out = make_samples(drives, _QUICK_HELD_OUT if quick else _HELD_OUT, seed=seed + 1)
    for index, fold in enumerate(folds):
        others = {other: each for other, each in enumerate(folds) if other != index}
        temper(fold, others, held_out)
    temper(network, dict(enumerate(folds)), held_out)
    export(
        network,
        {"window": torch.zeros(2, INPUTS)},
        output,
        model="radar",
        version=VERSION,
        kinds=RADAR_KINDS,
    )
    unseen = [(RadarEstimator(fold), drive) for fold, drive in zip(folds, drives, strict=True)]
    known = learned(
        drives,
        _QUICK_AMOUNTS if quick else _AMOUNTS,
        partial(fit_alone, seed=seed),
        draws=1 if quick else 2,
        seed=seed,
    )
    results = measured(unseen, RadarEstimator(output), known, quick=quick, seed=seed)
    parameters = sum(parameter.numel() for parameter in network.parameters())
    results.left_out.write(output.with_suffix(".json"))
    write_card(
        output.with_suffix(".md"),
        drives=drives,
        results=results,
        samples=len(samples.levels),
        parameters=parameters,
        temperatures=[network.temperature.of(*each) for each in TEMPERATURES],
        seed=seed,
    )
    return {
        "output": str(output),
        "samples": len(samples.levels),
        "parameters": parameters,
        **results.figures(),
    }


def fit(samples: Samples, seed: int, hidden: int = HIDDEN) -> RadarNet:
    """Train a network on samples of scans alone and with scans before them."""
    torch.manual_seed(seed)
    follows = samples.inputs[:, FOLLOWS] > 0.5
    alone, windows = samples.among(~follows), samples.among(follows)
    return RadarNet(
        _fit(alone, alone.inputs[:, :FEATURES], hidden), _fit(windows, windows.inputs, hidden)
    ).eval()


def fit_alone(samples: Samples, seed: int) -> RadarNet:
    """Train a network for single scans on samples of scans alone."""
    torch.manual_seed(seed)
    alone = _fit(samples, samples.inputs[:, :FEATURES], HIDDEN)
    return RadarNet(alone, alone).eval()


def _fit(samples: Samples, columns: NDArray[np.float32], hidden: int) -> Perceptron:
    inputs = torch.from_numpy(np.ascontiguousarray(columns))
    levels, kinds = torch.from_numpy(samples.levels), torch.from_numpy(samples.kinds)
    counts = torch.bincount(kinds, minlength=len(RADAR_KINDS)).clamp(min=1)
    kind_weights = len(kinds) / (len(RADAR_KINDS) * counts)
    level_weights = torch.tensor([_LEVEL_WEIGHTS[kind] for kind in RADAR_KINDS])[kinds]
    device = best_device()
    network = Perceptron(*_location_and_scale(inputs), hidden).to(device)
    inputs, levels, kinds = inputs.to(device), levels.to(device), kinds.to(device)
    kind_weights, level_weights = kind_weights.to(device), level_weights.to(device)

    def loss_of(batch: Tensor) -> Tensor:
        logits = network(inputs[batch])
        level, kind = logits[:, : len(LEVELS)], logits[:, len(LEVELS) :]
        loss = (level_weights[batch] * _level_loss(level, levels[batch])).mean()
        return loss + _KIND_WEIGHT * functional.cross_entropy(kind, kinds[batch], kind_weights)

    descend(
        torch.optim.AdamW(network.parameters(), weight_decay=_WEIGHT_DECAY),
        loss_of,
        len(inputs),
        batch=_BATCH,
        epochs=_EPOCHS,
        peak_rate=_PEAK_RATE,
    )
    return network.to("cpu")


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
