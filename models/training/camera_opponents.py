"""Opponents of the camera's network: ``murk train camera --opponent NAME``.

They learn from the same frames, varied in the same way, but degraded by the main kinds only, which
are all that they are measured on. They tell the level, not the kind.

=========  ================================================================================
regressor  classic measures and a perceptron of 32 hidden units that regresses the level
trees      gradient-boosted trees on the same measures, a class a level
paper      the paper's network, see ``models.training.camera_paper``
width_N    murk's own network, N = 16, 64 or 192 units wide, for what the width is worth
=========  ================================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter

import cv2
import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError, MissingExtra
from models.estimate.camera import CameraEstimator
from models.estimate.image_features import image_features
from models.estimate.level import LEVELS, Estimate
from models.estimate.network import softmax
from models.evaluate.camera import clean_frames, measure
from models.evaluate.classics import classic_features
from models.evaluate.codecs import Image
from models.evaluate.opponents import Opponent
from models.training.camera_frames import MAIN_ONLY, Clean, Samples, make_samples
from models.training.camera_network import Perceptron, fit
from models.training.camera_paper import CROP, fit_paper, paper_network, probabilities
from models.training.camera_simulated import simulated_frames

try:
    import torch
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.neural_network import MLPRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
except ImportError:
    raise MissingExtra("train", "murk train camera --opponent") from None

Estimator = Callable[[Image], Estimate]
Report = Callable[[dict[str, object]], None]

_PASSES = 3
_PAPER_EVERY = 2
_DRAWS = 8
_QUICK_FRAMES = 12
_ROUNDS = 30


@dataclass(frozen=True, slots=True)
class Trained:
    """A trained opponent: its estimator, what it is, and the size of it and of its training."""

    estimate: Estimator
    what: str
    samples: int
    parameters: int


def train_opponent(
    name: str, data: Path, output: Path, *, quick: bool, seed: int, report: Report
) -> dict[str, object]:
    """Train and measure one opponent, write its figures, and return them.

    Parameters
    ----------
    name:
        One of ``OPPONENTS``.
    data, quick, seed, report:
        As for ``models.training.camera.train``.
    output:
        JSON file to write.

    Raises
    ------
    InputError
        If there is no such opponent, or the data lack something.
    """
    if name not in OPPONENTS:
        raise InputError(f"--opponent {name}", "is unknown", f"expected {', '.join(OPPONENTS)}")
    splits = {split: clean_frames(data, split) for split in ("train", "val", "test")}
    if quick:
        splits = {
            split: frames[:: max(1, len(frames) // _QUICK_FRAMES)]
            for split, frames in splits.items()
        }
    simulated = simulated_frames(1, 2) if quick else simulated_frames(20, 6)
    trained = OPPONENTS[name]([*splits["train"], *simulated], quick, seed, report)
    report({"measuring": name})
    draws = 2 if quick else _DRAWS
    image = np.random.default_rng(0).integers(0, 256, (900, 1600, 3), np.uint8)
    opponent = Opponent(
        name=name,
        what=trained.what,
        samples=trained.samples,
        parameters=trained.parameters,
        run_time_us=_run_time_us(trained.estimate, image),
        shipped_run_time_us=_run_time_us(CameraEstimator().estimate, image),
        tables={
            split: measure(trained.estimate, splits[split], draws=draws).table()
            for split in ("val", "test")
        },
    )
    opponent.write(output)
    return {"output": str(output), "opponent": name, **opponent.tables}


def _regressor(frames: Sequence[Clean], quick: bool, seed: int, report: Report) -> Trained:
    samples = _classic_samples(frames, quick, seed, report)
    perceptron = MLPRegressor(
        hidden_layer_sizes=(32,), early_stopping=True, max_iter=200, random_state=seed
    )
    model = make_pipeline(StandardScaler(), perceptron)
    model.fit(samples.features, samples.levels / 100)

    def estimate(image: Image) -> Estimate:
        level = 100 * float(model.predict(classic_features(image)[np.newaxis])[0])
        return _only_level(_around(level))

    parameters = sum(weights.size for weights in [*perceptron.coefs_, *perceptron.intercepts_])
    what = "classic measures, perceptron of 32 hidden units"
    return Trained(estimate, what, len(samples.levels), parameters)


def _trees(frames: Sequence[Clean], quick: bool, seed: int, report: Report) -> Trained:
    samples = _classic_samples(frames, quick, seed, report)
    model = HistGradientBoostingClassifier(
        max_iter=10 if quick else 150, learning_rate=0.1, l2_regularization=1.0, random_state=seed
    )
    model.fit(samples.features, np.rint(samples.levels / 10).astype(int))

    def estimate(image: Image) -> Estimate:
        answer = np.zeros(len(LEVELS))
        answer[model.classes_] = model.predict_proba(classic_features(image)[np.newaxis])[0]
        return _only_level(answer)

    return Trained(estimate, "classic measures, gradient-boosted trees", len(samples.levels), 0)


def _paper(frames: Sequence[Clean], quick: bool, seed: int, report: Report) -> Trained:
    network, samples = fit_paper(frames[::_PAPER_EVERY], 1, seed, report)
    height, width = CROP
    what = (
        f"the paper's network, reduced: a native crop of {width} × {height} pixels from the middle "
        f"instead of 1600 × 900, so 24 inputs to the last layer instead of 400; {samples:,} "
        "samples, each seen once, one-cycle rate of at most 2e-3 instead of 1e-4 throughout"
    )
    whole = sum(weights.numel() for weights in paper_network(900, 1600).parameters())
    return Trained(
        lambda image: _only_level(probabilities(network, image)),
        f"{what}; {whole:,} parameters at full size",
        samples,
        sum(weights.numel() for weights in network.parameters()),
    )


def _width(hidden: int, frames: Sequence[Clean], quick: bool, seed: int, report: Report) -> Trained:
    samples = make_samples(frames, 1 if quick else _PASSES, seed, recipe=MAIN_ONLY)
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    features = torch.from_numpy(samples.features)
    network = Perceptron(features.mean(dim=0), features.std(dim=0) + 1e-2, hidden)
    fit(network, samples, epochs=30, peak_rate=3e-3, report=report)

    def estimate(image: Image) -> Estimate:
        with torch.no_grad():
            level, _ = network(torch.from_numpy(image_features(image)[np.newaxis]))
        return _only_level(softmax(level[0].numpy()))

    what = f"murk's network, {hidden} units wide, main kinds only"
    parameters = sum(weights.numel() for weights in network.parameters())
    return Trained(estimate, what, len(samples.levels), parameters)


OPPONENTS: dict[str, Callable[[Sequence[Clean], bool, int, Report], Trained]] = {
    "regressor": _regressor,
    "trees": _trees,
    "paper": _paper,
    "width_16": partial(_width, 16),
    "width_64": partial(_width, 64),
    "width_192": partial(_width, 192),
}


def _classic_samples(frames: Sequence[Clean], quick: bool, seed: int, report: Report) -> Samples:
    samples = make_samples(
        frames, 1 if quick else _PASSES, seed, recipe=MAIN_ONLY, describe=classic_features
    )
    report({"samples": len(samples.levels)})
    return samples


def _only_level(probabilities: NDArray[np.float64]) -> Estimate:
    return Estimate(probabilities, {"unknown": 1.0})


def _around(level: float) -> NDArray[np.float64]:
    """Return the distribution over the eleven levels whose mean is this one, as narrow as it is."""
    distance = np.abs(np.clip(level, 0, 100) - LEVELS) / (LEVELS[1] - LEVELS[0])
    return np.maximum(1 - distance, 0)


def _run_time_us(estimate: Estimator, image: Image) -> float:
    """Return the median run time of one estimate on one thread, microseconds."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    times = []
    for _ in range(_ROUNDS):
        start = perf_counter()
        estimate(image)
        times.append(perf_counter() - start)
    cv2.setNumThreads(threads)
    return median(times) * 1e6
