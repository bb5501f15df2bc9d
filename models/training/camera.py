"""Trains the camera's network: ``murk train camera``.

A perceptron on ``image_features``; it answers in logits over the eleven levels and over the kinds.
The loss adds to the cross entropy the squared distance of the cumulative distributions (ranked
probability score), because the levels are ordered: 50 % for 40 % is better than for 0 %.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from models.estimate.camera import VERSION, CameraEstimator
from models.estimate.image_features import image_features
from models.estimate.level import CAMERA_KINDS, LEVELS
from models.estimate.network import softmax
from models.evaluate.camera import Answers, CleanFrame, clean_frames, degraded, measure
from models.training.camera_card import write_card
from models.training.camera_frames import Clean, Samples, make_samples
from models.training.camera_simulated import simulated_frames

try:
    import torch
    from torch.nn import functional

    from models.training.export import export
except ImportError:
    raise MissingExtra("train", "murk train camera") from None

if TYPE_CHECKING:
    from torch import Tensor

Report = Callable[[dict[str, object]], None]

_HIDDEN = 192
_BATCH = 256
_PEAK_RATE = 3e-3
_WEIGHT_DECAY = 2e-2
_RANKED_WEIGHT = 2.0
_KIND_WEIGHT = 0.5
_CLEAN = CAMERA_KINDS.index("clean")
_CLEAN_WEIGHT = 3.0  # most frames of a drive are clean: a false alarm is the costliest error
_STANDARD_DEVIATIONS = 5.0

_PASSES = 12
_EPOCHS = 40
_WORLDS = 20
_FRAMES_A_WORLD = 6
_DRAWS = 8
_QUICK_FRAMES = 12


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
            torch.nn.Dropout(0.1),
            torch.nn.Linear(len(mean), _HIDDEN),
            torch.nn.SiLU(),
            torch.nn.Dropout(0.2),
            torch.nn.Linear(_HIDDEN, _HIDDEN),
            torch.nn.SiLU(),
            torch.nn.Dropout(0.1),
            torch.nn.Linear(_HIDDEN, len(LEVELS) + len(CAMERA_KINDS)),
        )

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits of level (batch, 11) and of kind (batch, 5)."""
        limit = _STANDARD_DEVIATIONS
        standard = ((features - self.mean) / self.std).clamp(-limit, limit)
        logits = self.layers(standard)
        level, kind = logits[:, : len(LEVELS)], logits[:, len(LEVELS) :]
        return level / self.temperature, kind


def train(data: Path, output: Path, *, quick: bool, seed: int, report: Report) -> dict[str, object]:
    """Train the camera's network, write it and its card, and return what it reaches.

    Deterministic on one machine: the same data and seed give the same file.

    Parameters
    ----------
    data:
        Folder with ``camera/index.csv``.
    output:
        ONNX file to write; its card goes beside it with the suffix ``.md``.
    quick:
        A few frames and epochs, in seconds: to see that it runs, not to be used.
    seed:
        Of the variations, the degradations and the network.
    report:
        Called with a record of the progress after every tenth of the training.

    Returns
    -------
    dict
        ``output``, ``samples``, ``parameters``, and the tables of the splits ``val`` and ``test``.

    Raises
    ------
    InputError
        If the data lack something.
    """
    splits = {split: clean_frames(data, split) for split in ("train", "val", "test")}
    if quick:
        splits = {
            split: frames[:: max(1, len(frames) // _QUICK_FRAMES)]
            for split, frames in splits.items()
        }
    simulated = simulated_frames(1, 2) if quick else simulated_frames(_WORLDS, _FRAMES_A_WORLD)
    frames: list[Clean] = [*splits["train"], *simulated]
    samples = make_samples(frames, passes=1 if quick else _PASSES, seed=seed)
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    network = _fit(samples, _EPOCHS, report)
    _calibrate(network, splits["val"], draws=2 if quick else _DRAWS, seed=seed)
    export(
        network,
        {"features": torch.zeros(1, len(network.mean))},
        output,
        model="camera",
        version=VERSION,
        kinds=CAMERA_KINDS,
    )
    estimator = CameraEstimator(output)
    answers: dict[str, Answers] = {
        split: measure(estimator.estimate, splits[split], draws=2 if quick else _DRAWS)
        for split in ("val", "test")
    }
    parameters = sum(parameter.numel() for parameter in network.parameters())
    write_card(
        output.with_suffix(".md"),
        splits=splits,
        answers=answers,
        simulated=len(simulated),
        samples=len(samples.levels),
        parameters=parameters,
        seed=seed,
    )
    return {
        "output": str(output),
        "samples": len(samples.levels),
        "parameters": parameters,
        **{split: answer.table() for split, answer in answers.items()},
    }


def _fit(samples: Samples, epochs: int, report: Report) -> Perceptron:
    features = torch.from_numpy(samples.features)
    levels = torch.from_numpy(_spread_over_levels(samples.levels))
    kinds = torch.from_numpy(samples.kinds)
    network = Perceptron(features.mean(dim=0), features.std(dim=0) + 1e-2)
    steps = epochs * -(-len(features) // _BATCH)
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=_WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, _PEAK_RATE, total_steps=steps)
    for epoch in range(epochs):
        total = 0.0
        for batch in torch.split(torch.randperm(len(features)), _BATCH):
            loss = _loss(network(features[batch]), levels[batch], kinds[batch])
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
            total += loss.item() * len(batch)
        if (epoch + 1) % (epochs // 10) == 0:
            report({"epoch": epoch + 1, "of": epochs, "loss": total / len(features)})
    return network.eval()


def _spread_over_levels(levels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the distribution over the eleven levels that a level between two of them means."""
    distance = np.abs(levels[:, np.newaxis] - LEVELS) / (LEVELS[1] - LEVELS[0])
    return np.maximum(1 - distance, 0).astype(np.float32)


def _loss(logits: tuple[Tensor, Tensor], levels: Tensor, kinds: Tensor) -> Tensor:
    level, kind = logits
    apart = level.softmax(dim=1).cumsum(dim=1) - levels.cumsum(dim=1)
    losses = (
        functional.cross_entropy(level, levels, reduction="none")
        + _RANKED_WEIGHT * apart.square().sum(dim=1)
        + _KIND_WEIGHT * functional.cross_entropy(kind, kinds, reduction="none")
    )
    weights = torch.where(kinds == _CLEAN, _CLEAN_WEIGHT, 1.0)
    return (weights * losses).sum() / weights.sum()


def _calibrate(network: Perceptron, frames: list[CleanFrame], *, draws: int, seed: int) -> None:
    """Set the temperature that makes the true level of held-out frames most likely."""
    truth, features = [], []
    for _, _, level, image in degraded(frames, draws=draws, seed=seed + 1):
        truth.append(int(np.searchsorted(LEVELS, level)))
        features.append(image_features(image))
    with torch.no_grad():
        logits, _ = network(torch.from_numpy(np.array(features)))
    network.temperature.fill_(_best_temperature(logits.numpy(), np.array(truth)))


def _best_temperature(logits: NDArray[np.float32], right: NDArray[np.intp]) -> float:
    candidates = np.geomspace(0.5, 4, 61)
    rows = np.arange(len(right))
    surprise = [
        -np.mean(np.log(softmax(logits / candidate)[rows, right] + 1e-12))
        for candidate in candidates
    ]
    return float(candidates[int(np.argmin(surprise))])
