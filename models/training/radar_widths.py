"""The radar's network by the width of its hidden layers: error against run time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from dbc.errors import MissingExtra
from models.estimate.level import RADAR_KINDS
from models.estimate.radar import RadarEstimator
from models.estimate.radar_window import INPUTS, VERSION
from models.evaluate.radar import Drive, measure_together
from models.evaluate.report import Point
from models.evaluate.timing import median_us

try:
    import torch

    from models.training.export import export
    from models.training.radar import HIDDEN, fit
    from models.training.radar_scans import Samples
except ImportError:
    raise MissingExtra("train", "murk bench opponents") from None

UNIT = "points of level, a simulated second"
WIDTHS = (4, 16, HIDDEN, 128)
_SECOND = 14
_ROUNDS = 200


def width_points(samples: Samples, drives: Sequence[Drive], seed: int) -> Iterator[Point]:
    """Train a network of each width on the same samples; yield its error on unseen drives.

    Parameters
    ----------
    drives:
        Of a second at least, simulated; the last scan of each second is measured.
    """
    for hidden in WIDTHS:
        network = fit(samples, seed, hidden)
        with TemporaryDirectory() as folder:
            file = Path(folder) / "radar.onnx"
            example = {"window": torch.zeros(2, INPUTS)}
            export(network, example, file, model="radar", version=VERSION, kinds=RADAR_KINDS)
            estimator = RadarEstimator(file)
        answers = measure_together(
            estimator.follow, drives, None, scans=_SECOND, draws=1, seed=seed
        )
        follow, scans = estimator.follow(), iter(drives[0].scans * _ROUNDS)
        run_time_us = median_us(lambda: follow(next(scans)), _ROUNDS)  # noqa: B023
        parameters = sum(one.numel() for one in network.parameters())
        knob = f"hidden={hidden}, {parameters:,} parameters"
        error = answers.figures()["mean_error"]
        yield Point("width", knob, run_time_us, error, UNIT, shipped=hidden == HIDDEN)
