"""Opponents of the camera's network: ``murk train camera --opponent NAME``.

They learn from the same frames, varied in the same way, but degraded by the main kinds only, which
are all that they are measured on. They tell the level, not the kind.

================  =========================================================================
regressor         classic measures and a perceptron of 32 hidden units that regresses the level
trees             gradient-boosted trees on the same measures, a class a level
paper             the paper's network with what helps it, see ``models.training.camera_paper``
paper_as_written  the same with no more than what the paper writes
width_N           murk's own network, N = 16, 64 or 192 units wide: what the width is worth
shrunk_N          the same, 192 wide, with the frame shrunk to 1/N first, N = 2 or 4: what it loses
================  =========================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import cv2
import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError, MissingExtra
from models.estimate.camera import VERSION, CameraEstimator
from models.estimate.exposure import SEEN
from models.estimate.image_features import image_features
from models.estimate.level import FRAME_KINDS, LEVELS, Estimate
from models.evaluate.camera import measure
from models.evaluate.classics import classic_features
from models.evaluate.codecs import Image
from models.evaluate.opponents import Opponent
from models.evaluate.timing import median_us, one_thread
from models.training.camera_frames import MAIN_ONLY, Clean, Samples, make_samples, read_splits
from models.training.camera_network import Perceptron, Successive, fit
from models.training.camera_paper import CROP, crop, fit_paper, paper_network, probabilities
from models.training.camera_simulated import simulated_frames

try:
    import torch
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.neural_network import MLPRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    from models.training.export import export
except ImportError:
    raise MissingExtra("train", "murk train camera --opponent") from None

Estimator = Callable[[Image], Estimate]
Report = Callable[[dict[str, object]], None]

_PASSES = 3
_EPOCHS = 30
_DRAWS = 8
_ROUNDS = 20
_CLASSIC = "classic_features"


@dataclass(frozen=True, slots=True)
class Trained:
    """A trained opponent: its estimator, what it is and reads, its size and its training's."""

    estimate: Estimator
    what: str
    inputs: str
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
    splits = read_splits(data, ("train", "val", "test"), quick=quick)
    simulated = simulated_frames(1, 2) if quick else simulated_frames(20, 6)
    trained = OPPONENTS[name]([*splits["train"], *simulated], quick, seed, report)
    report({"measuring": name})
    draws = 2 if quick else _DRAWS
    run_time_us, shipped_run_time_us = _run_times_us([trained.estimate, CameraEstimator().estimate])
    opponent = Opponent(
        name=name,
        what=trained.what,
        inputs=trained.inputs,
        samples=trained.samples,
        parameters=trained.parameters,
        run_time_us=run_time_us,
        shipped_run_time_us=shipped_run_time_us,
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
        hidden_layer_sizes=(32,), early_stopping=True, max_iter=1000, random_state=seed
    )
    model = make_pipeline(StandardScaler(), perceptron)
    model.fit(samples.features, samples.levels / 100)

    def estimate(image: Image) -> Estimate:
        level = 100 * float(model.predict(classic_features(image)[np.newaxis])[0])
        return _only_level(_around(level))

    parameters = sum(weights.size for weights in [*perceptron.coefs_, *perceptron.intercepts_])
    what = "classic measures, perceptron of 32 hidden units"
    return Trained(estimate, what, _CLASSIC, len(samples.levels), parameters)


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

    what = "classic measures, gradient-boosted trees"
    return Trained(estimate, what, _CLASSIC, len(samples.levels), 0)


def _paper(
    as_written: bool, frames: Sequence[Clean], quick: bool, seed: int, report: Report
) -> Trained:
    start = process_time()
    network, crops = fit_paper(frames, seed, report, as_written=as_written, quick=quick)
    minutes = (process_time() - start) / 60
    height, width = CROP
    whole, image = paper_network(900, 1600), np.zeros((900, 1600, 3), np.uint8)
    whole_ms = min(median_us(lambda: probabilities(whole, image), 1) for _ in range(5)) / 1e3
    how = (
        "raw values, PyTorch's initialisation, Adam at 1e-4"
        if as_written
        else "standardised values, He's initialisation, the first five blocks trained before six "
        "and seven, on small windows"
    )
    what = (
        f"the paper's network on a native crop of {width} × {height} pixels from the middle; "
        f"{how}; {minutes:.0f} minutes of one core. At 1600 × 900 it has "
        f"{sum(weights.numel() for weights in whole.parameters()):,} parameters and takes "
        f"{whole_ms:.0f} ms"
    )
    return Trained(
        lambda image: _only_level(probabilities(network, crop(image))),
        what,
        f"crop of {width} × {height} pixels, BGR",
        crops,
        sum(weights.numel() for weights in network.parameters()),
    )


def _own(
    hidden: int, shrink: int, frames: Sequence[Clean], quick: bool, seed: int, report: Report
) -> Trained:
    describe = partial(_shrunk_features, shrink)
    passes = 1 if quick else _PASSES
    samples = make_samples(frames, passes, seed, recipe=MAIN_ONLY, describe=describe)
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    features = torch.from_numpy(samples.features)
    network = Perceptron(features.mean(dim=0), features.std(dim=0) + 1e-2, hidden)
    fit(network, samples, epochs=_EPOCHS, peak_rate=3e-3, report=report)
    example = {"features": features[:1], "history": torch.zeros(1, SEEN)}
    with TemporaryDirectory() as folder:
        file = Path(folder) / "camera.onnx"
        export(
            Successive(network), example, file, model="camera", version=VERSION, kinds=FRAME_KINDS
        )
        estimator = CameraEstimator(file)
    return Trained(
        lambda image: estimator.estimate(_shrunk(image, shrink)),
        f"murk's network, {hidden} units wide, main kinds only, {passes} passes, {_EPOCHS} epochs"
        + (f"; frame shrunk to 1/{shrink} first" if shrink > 1 else ""),
        f"image_features, version {VERSION}, {features.shape[1]} values",
        len(samples.levels),
        sum(weights.numel() for weights in network.parameters()),
    )


def _shrunk_features(shrink: int, image: Image) -> NDArray[np.float32]:
    return image_features(_shrunk(image, shrink))


def _shrunk(image: Image, shrink: int) -> Image:
    """Return the frame at 1/shrink of its height and width, at least one pixel of each."""
    if shrink == 1:
        return image
    size = [max(1, length // shrink) for length in image.shape[1::-1]]
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


OPPONENTS: dict[str, Callable[[Sequence[Clean], bool, int, Report], Trained]] = {
    "regressor": _regressor,
    "trees": _trees,
    "paper": partial(_paper, False),
    "paper_as_written": partial(_paper, True),
    "width_16": partial(_own, 16, 1),
    "width_64": partial(_own, 64, 1),
    "width_192": partial(_own, 192, 1),
    "shrunk_2": partial(_own, 192, 2),
    "shrunk_4": partial(_own, 192, 4),
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


def _run_times_us(estimators: Sequence[Estimator]) -> list[float]:
    """Return the run time of each at 1600 × 900 on one thread, µs.

    They take turns, and of twenty turns the fastest counts: other load only ever adds.
    """
    image = np.random.default_rng(0).integers(0, 256, (900, 1600, 3), np.uint8)
    with one_thread():
        rounds = [
            [median_us(partial(estimate, image), 3) for estimate in estimators]
            for _ in range(_ROUNDS)
        ]
    return [min(times) for times in zip(*rounds, strict=True)]
