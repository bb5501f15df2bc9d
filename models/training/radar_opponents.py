"""Opponents of the radar's network: ``murk train radar --opponent NAME``.

They learn from the same drives, degraded in the same way, though from fewer samples, and they are
measured as the network is: on each recorded drive by one that was trained without it, and on
simulated drives that are in no training. The first three look at one scan, degraded by ``snr``, and
tell its level only; the others are murk's own network.

====================  =========================================================================
regressor             features of a scan (counts, quantiles of RCS − 40 log r, Doppler) and a
                      perceptron of 32 hidden units that regresses the level; the spread of its
                      residuals is how sure it is
trees                 gradient-boosted trees on the same features, a class a level
paper                 the paper's network, see ``models.training.radar_paper``
width_N               murk's own network, N = 4, 16, 64 or 128 units wide: what the width is worth
trained_on_recorded   the same as it ships, without simulated drives: what they contribute
trained_on_simulated  the same without recorded drives
====================  =========================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError, MissingExtra
from drivers.scan import RadarScan
from models.estimate.level import LEVELS, RADAR_KINDS, Estimate
from models.estimate.network import softmax
from models.estimate.radar import RadarEstimator
from models.estimate.radar_features import features
from models.estimate.radar_view import view
from models.estimate.radar_window import INPUTS, VERSION
from models.evaluate.opponents import Opponent
from models.evaluate.radar import (
    Answers,
    Drive,
    Estimator,
    joined,
    measure_together,
    recorded_drives,
)
from models.evaluate.radar_trial import SECOND, run_time_us, trial_drives
from models.training.radar_scans import (
    SIMULATED,
    Amounts,
    degraded_sequences,
    make_samples,
)

try:
    import torch
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.neural_network import MLPRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    from models.training.export import export
    from models.training.radar import HIDDEN, fit
    from models.training.radar_paper import fit_paper, probabilities, raw_columns
except ImportError:
    raise MissingExtra("train", "murk train radar --opponent") from None

Report = Callable[[dict[str, object]], None]
Follow = Callable[[], Estimator]
"""Makes an estimator for successive scans of one sensor."""
Columns = NDArray[np.floating]
"""What an opponent reads of a scan."""

_AMOUNTS = Amounts(repeats=3, joined=300, worlds=40, sparse=30)
_QUICK_AMOUNTS = Amounts(repeats=1, joined=2, worlds=2, sparse=2)
_QUICK_DRIVES, _QUICK_SCANS = 2, 7
_SEVEN = 7
_DRAWS = 2
_ROUNDS, _TURN = 20, 5
_KINDS = dict.fromkeys(RADAR_KINDS, 1 / len(RADAR_KINDS))
_FEATURES = "radar_features"


@dataclass(frozen=True, slots=True)
class Model:
    """What tells the level of a scan.

    Attributes
    ----------
    probabilities:
        From what it reads of a scan to (11,).
    parameters:
        How many it has; 0 where there are none to count.
    """

    probabilities: Callable[[Columns], NDArray[np.float64]]
    parameters: int


@dataclass(frozen=True, slots=True)
class Trained:
    """A trained opponent.

    Attributes
    ----------
    folds:
        One a recorded drive, trained without it.
    timed:
        What its run time is that of.
    what, inputs:
        What it is, and what it reads.
    scans:
        Most scans that it takes together: 1, or a window's.
    samples, parameters:
        Of its training; parameters are 0 where it has none to count.
    """

    folds: list[Follow]
    timed: Follow
    what: str
    inputs: str
    scans: int
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
        As for ``models.training.radar.train``.
    output:
        JSON file to write.

    Raises
    ------
    InputError
        If there is no such opponent, or the data lack something.
    """
    if name not in OPPONENTS:
        raise InputError(f"--opponent {name}", "is unknown", f"expected {', '.join(OPPONENTS)}")
    torch.set_num_threads(1)
    drives = recorded_drives(data)
    if quick:
        drives = [Drive(drive.name, drive.scans[:_QUICK_SCANS]) for drive in drives[:_QUICK_DRIVES]]
    trained = OPPONENTS[name](drives, _QUICK_AMOUNTS if quick else _AMOUNTS, seed, report)
    report({"measuring": name})
    simulated = trial_drives(quick)
    times_us = _run_times_us([trained.timed, RadarEstimator().follow], simulated[0])
    tables = _measured(trained, drives, simulated, quick=quick, seed=seed)
    opponent = Opponent(
        name=name,
        what=trained.what,
        inputs=trained.inputs,
        samples=trained.samples,
        parameters=trained.parameters,
        run_time_us=times_us[0],
        shipped_run_time_us=times_us[1],
        tables={place: {"all": answers.figures()} for place, answers in tables.items()},
    )
    opponent.write(output)
    return {"output": str(output), "opponent": name, **opponent.tables}


def _measured(
    trained: Trained, drives: Sequence[Drive], simulated: Sequence[Drive], *, quick: bool, seed: int
) -> dict[str, Answers]:
    """Return the answers to recorded drives left out and to simulated ones."""
    draws = 1 if quick else _DRAWS

    def recorded(scans: int) -> Answers:
        return joined(
            [
                measure_together(follow, [drive], None, scans=scans, draws=draws, seed=seed)
                for follow, drive in zip(trained.folds, drives, strict=True)
            ]
        )

    def unseen(scans: int) -> Answers:
        return measure_together(trained.folds[0], simulated, None, scans=scans, draws=1)

    answers = {"recorded_scan": recorded(1), "simulated_scan": unseen(1)}
    if trained.scans > 1:
        answers["recorded_seven_scans"] = recorded(_SEVEN)
        answers["simulated_second"] = unseen(SECOND)
    return answers


def _one_scan(
    what: str,
    inputs: str,
    describe: Callable[[RadarScan], Columns],
    train: Callable[[Sequence[Columns], NDArray[np.int64], int], Model],
    drives: Sequence[Drive],
    amounts: Amounts,
    seed: int,
    report: Report,
) -> Trained:
    """Train an opponent that looks at one scan degraded by ``snr``, once without each drive."""
    columns, levels, origins = [], [], []
    for sequence in degraded_sequences(drives, amounts, np.random.default_rng(seed), seed):
        if sequence.kind == "snr":
            for scan, level in zip(sequence.scans, sequence.levels, strict=True):
                if len(scan):
                    columns.append(describe(scan))
                    levels.append(int(np.searchsorted(LEVELS, level)))
                    origins.append(sequence.origin)
    report({"samples": len(levels)})
    folds: list[Follow] = []
    for index, drive in enumerate(drives):
        own = np.flatnonzero((np.array(origins) != index).all(axis=1))
        model = train([columns[k] for k in own], np.array(levels)[own], seed)
        folds.append(partial(_estimator, describe, model))
        report({"trained without": drive.name, "fold": index + 1, "of": len(drives)})
    return Trained(folds, folds[0], what, inputs, 1, len(levels), model.parameters)


def _estimator(describe: Callable[[RadarScan], Columns], model: Model) -> Estimator:
    return lambda scan: Estimate(model.probabilities(describe(scan)), _KINDS)


def _scan_features(scan: RadarScan) -> NDArray[np.float64]:
    return features(view(scan))


def _regressor(columns: Sequence[Columns], levels: NDArray[np.int64], seed: int) -> Model:
    perceptron = MLPRegressor(
        hidden_layer_sizes=(32,), early_stopping=True, max_iter=1000, random_state=seed
    )
    model = make_pipeline(StandardScaler(), perceptron)
    model.fit(np.array(columns), LEVELS[levels] / LEVELS[-1])
    spread = float(np.std(LEVELS[-1] * model.predict(np.array(columns)) - LEVELS[levels]))

    def probabilities(own: Columns) -> NDArray[np.float64]:
        level = LEVELS[-1] * model.predict(own[np.newaxis])[0]
        return softmax(-0.5 * ((LEVELS - level) / spread) ** 2)

    parameters = sum(weights.size for weights in [*perceptron.coefs_, *perceptron.intercepts_])
    return Model(probabilities, parameters)


def _trees(columns: Sequence[Columns], levels: NDArray[np.int64], seed: int) -> Model:
    model = HistGradientBoostingClassifier(max_iter=60, learning_rate=0.1, random_state=seed)
    model.fit(np.array(columns), levels)
    return Model(lambda own: np.asarray(model.predict_proba(own[np.newaxis])[0]), 0)


def _paper(columns: Sequence[Columns], levels: NDArray[np.int64], seed: int) -> Model:
    network = fit_paper(columns, levels, seed)
    parameters = sum(weights.numel() for weights in network.parameters())
    return Model(partial(probabilities, network), parameters)


def _own(
    hidden: int,
    among: Callable[[NDArray[np.bool_]], NDArray[np.bool_]],
    drives: Sequence[Drive],
    amounts: Amounts,
    seed: int,
    report: Report,
) -> Trained:
    """Train murk's own network once without each drive.

    Parameters
    ----------
    hidden:
        Width of its hidden layers.
    among:
        Which samples it learns from, of (n,) whether they are simulated.
    """
    samples = make_samples(drives, amounts, seed=seed)
    samples = samples.among(among((samples.drives == SIMULATED).all(axis=1)))
    report({"samples": len(samples.levels)})
    networks = []
    for index, drive in enumerate(drives):
        networks.append(fit(samples.without(index), seed, hidden))
        report({"trained without": drive.name, "fold": index + 1, "of": len(drives)})
    with TemporaryDirectory() as folder:
        file = Path(folder) / "radar.onnx"
        example = {"window": torch.zeros(2, INPUTS)}
        export(networks[0], example, file, model="radar", version=VERSION, kinds=RADAR_KINDS)
        timed = RadarEstimator(file)
    return Trained(
        folds=[RadarEstimator(network).follow for network in networks],
        timed=timed.follow,
        what=f"murk's network, {hidden} units wide",
        inputs=f"radar_window, version {VERSION}, {INPUTS} values",
        scans=SECOND,
        samples=len(samples.levels),
        parameters=sum(weights.numel() for weights in networks[0].parameters()),
    )


OPPONENTS: dict[str, Callable[[Sequence[Drive], Amounts, int, Report], Trained]] = {
    "regressor": partial(
        _one_scan, "perceptron of 32 hidden units", _FEATURES, _scan_features, _regressor
    ),
    "trees": partial(_one_scan, "gradient-boosted trees", _FEATURES, _scan_features, _trees),
    "paper": partial(
        _one_scan,
        "the paper's network; quality fields 0, standardised columns, Adam at 1e-3, four epochs",
        "18 raw columns a cluster",
        raw_columns,
        _paper,
    ),
    **{f"width_{hidden}": partial(_own, hidden, np.ones_like) for hidden in (4, 16, 64, 128)},
    "trained_on_recorded": partial(_own, HIDDEN, np.logical_not),
    "trained_on_simulated": partial(_own, HIDDEN, np.asarray),
}


def _run_times_us(followers: Sequence[Follow], drive: Drive) -> list[float]:
    """Return the run time of one more scan on one thread, µs.

    They take turns, and of twenty turns the fastest counts: other load only ever adds.
    """
    rounds = [
        [run_time_us(follow, drive, SECOND, _TURN) for follow in followers] for _ in range(_ROUNDS)
    ]
    return [min(times) for times in zip(*rounds, strict=True)]
