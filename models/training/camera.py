"""Trains the camera's network: ``murk train camera``.

A perceptron on ``image_features``, and a small network that tells a tunnel by what was before the
frame; they answer in logits over the eleven levels and over the kinds.
Where the data are a user's own drives, without murk's index, the shipped network is fine-tuned on
them instead.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from models.estimate.camera import VERSION, CameraEstimator
from models.estimate.exposure import SEEN
from models.estimate.image_features import image_features
from models.estimate.level import FRAME_KINDS, LEVELS
from models.estimate.network import softmax
from models.evaluate.camera import Answers, CleanFrame, degraded, measure
from models.training.camera_card import write_card
from models.training.camera_frames import Clean, make_samples, read_splits
from models.training.camera_history import make_successive
from models.training.camera_simulated import simulated_frames

try:
    import torch

    from models.training.camera_network import (
        Perceptron,
        Successive,
        favour_clean,
        fit,
        fit_tunnel,
    )
    from models.training.camera_tune import find_drives, tune
    from models.training.export import export
except ImportError:
    raise MissingExtra("train", "murk train camera") from None

Report = Callable[[dict[str, object]], None]

_PEAK_RATE = 3e-3

_PASSES = 18
_EPOCHS = 40
_SUCCESSIVE_PASSES = 4
_TUNNEL_RATE = 5e-3
_TUNNEL_EPOCHS = 150
_WORLDS = 20
_FRAMES_A_WORLD = 6
_DRAWS = 8


def train(data: Path, output: Path, *, quick: bool, seed: int, report: Report) -> dict[str, object]:
    """Train the camera's network, write it and its card, and return what it reaches.

    Without ``camera/index.csv`` in the data, see ``models.training.camera_tune``.

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
    if not (data / "camera" / "index.csv").is_file() and find_drives(data):
        return tune(data, output, quick=quick, seed=seed, report=report)
    splits = read_splits(data, ("train", "val", "test"), quick=quick)
    simulated = simulated_frames(1, 2) if quick else simulated_frames(_WORLDS, _FRAMES_A_WORLD)
    frames: list[Clean] = [*splits["train"], *simulated]
    samples = make_samples(frames, passes=1 if quick else _PASSES, seed=seed)
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    features = torch.from_numpy(samples.features)
    image = Perceptron(features.mean(dim=0), features.std(dim=0) + 1e-2)
    fit(image, samples, epochs=_EPOCHS, peak_rate=_PEAK_RATE, report=report)
    successive, histories = make_successive(
        frames, passes=1 if quick else _SUCCESSIVE_PASSES, seed=seed
    )
    torch.manual_seed(seed)
    network = Successive(image)
    fit_tunnel(
        network,
        successive,
        histories,
        epochs=_TUNNEL_EPOCHS,
        peak_rate=_TUNNEL_RATE,
        report=report,
    )
    favour_clean(network)
    _calibrate(network, splits["val"], draws=2 if quick else _DRAWS, seed=seed)
    export(
        network,
        {"features": torch.zeros(1, len(image.mean)), "history": torch.zeros(1, SEEN)},
        output,
        model="camera",
        version=VERSION,
        kinds=FRAME_KINDS,
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
        successive=len(successive.levels),
        parameters=parameters,
        seed=seed,
    )
    return {
        "output": str(output),
        "samples": len(samples.levels),
        "parameters": parameters,
        **{split: answer.table() for split, answer in answers.items()},
    }


def _calibrate(network: Successive, frames: list[CleanFrame], *, draws: int, seed: int) -> None:
    """Set the temperature that makes the true level of held-out frames most likely."""
    truth, features = [], []
    for _, _, level, image in degraded(frames, draws=draws, seed=seed + 1):
        truth.append(int(np.searchsorted(LEVELS, level)))
        features.append(image_features(image))
    with torch.no_grad():
        alone = torch.zeros(len(features), SEEN)
        logits, _ = network(torch.from_numpy(np.array(features)), alone)
    network.temperature.fill_(_best_temperature(logits.numpy(), np.array(truth)))


def _best_temperature(logits: NDArray[np.float32], right: NDArray[np.intp]) -> float:
    candidates = np.geomspace(0.5, 4, 61)
    rows = np.arange(len(right))
    surprise = [
        -np.mean(np.log(softmax(logits / candidate)[rows, right] + 1e-12))
        for candidate in candidates
    ]
    return float(candidates[int(np.argmin(surprise))])
