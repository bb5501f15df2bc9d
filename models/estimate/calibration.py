"""A small correction of one sensor's estimates, fitted to some minutes of its clean driving.

First every kind's levels move on a straight line of its own, for a sensor of soft pictures shows
every blur too strong. Then the probabilities p become p^a · exp(b), normalised, with one exponent
for all levels and an offset for each (vector scaling with one temperature; Guo et al., "On
calibration of modern neural networks", ICML 2017). Clean data suffices, because murk degrades it at
known levels itself.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from models.estimate.level import LEVELS, Estimate

_N = len(LEVELS)
_LEAST = 1e-6
"""Probability below which the network's answers are taken for this: none is ever beyond doubt."""
_PRIOR = 3.0
"""Weight of the identity, in messages."""
_LINE_PRIOR = 20.0 * 100.0
"""Weight of the identity in a kind's line: 20 messages that are right, 10 points apart."""
_ROUNDS = 50
_CONVERGED = 1e-9


@dataclass(frozen=True, slots=True)
class Calibration:
    """The correction of one sensor.

    Attributes
    ----------
    sensor:
        ``camera`` or ``radar``.
    lines:
        By kind, slope and offset (points) of the line on which its levels move; other kinds stay.
    exponent:
        Of the probabilities, > 0; below 1 the network was too sure.
    offsets:
        Eleven, one a level, added to the logarithms.
    """

    sensor: str
    lines: dict[str, tuple[float, float]]
    exponent: float
    offsets: tuple[float, ...]

    def apply(self, estimate: Estimate) -> Estimate:
        """Return the corrected estimate; the kinds stay as they are."""
        logs = _logs(_moved(estimate, self.lines))
        return replace(estimate, probabilities=_softmax(self.exponent * logs + self.offsets))

    def write(self, path: Path) -> None:
        """Write it as a JSON file.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        try:
            path.write_text(json.dumps({"murk": "calibration", **asdict(self)}) + "\n", "utf-8")
        except OSError as error:
            raise InputError(path, error.strerror or "cannot be written") from None

    @classmethod
    def read(cls, path: Path, sensor: str) -> Self:
        """Return the correction in a file.

        Raises
        ------
        InputError
            If the file cannot be read or is no correction of such a sensor.
        """
        expected = f"expected a file that 'murk calibrate {sensor}' wrote"
        try:
            content: dict[str, Any] = json.loads(path.read_text("utf-8"))
            found = cls(
                str(content["sensor"]),
                {kind: (float(a), float(b)) for kind, (a, b) in content["lines"].items()},
                float(content["exponent"]),
                tuple(map(float, content["offsets"])),
            )
        except OSError as error:
            raise InputError(path, error.strerror or "cannot be read", expected) from None
        except (ValueError, KeyError, TypeError, AttributeError):
            raise InputError(path, "is no calibration", expected) from None
        values = np.array([found.exponent, *found.offsets, *chain(*found.lines.values())])
        if len(found.offsets) != _N or not np.isfinite(values).all() or found.exponent <= 0:
            raise InputError(path, "is no calibration", expected)
        if found.sensor != sensor:
            raise InputError(path, f"is for a {found.sensor}", expected)
        return found


def fit(sensor: str, estimates: Sequence[Estimate], levels: Sequence[float]) -> Calibration:
    """Return the correction under which the true levels are most likely.

    Parameters
    ----------
    estimates:
        What the network answered.
    levels:
        The true levels, %, each one of the eleven, as many.
    """
    lines = {
        kind: _line(
            [
                (e.level, level)
                for e, level in zip(estimates, levels, strict=True)
                if level and e.kind == kind
            ]
        )
        for kind in sorted({estimate.kind for estimate in estimates} - {"clean"})
    }
    moved = np.array([_moved(estimate, lines) for estimate in estimates])
    exponent, offsets = _scaling(moved, levels)
    return Calibration(sensor, lines, exponent, offsets)


def _line(pairs: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return slope and offset from estimated to true levels: least squares, drawn to (1, 0)."""
    if not pairs:
        return 1.0, 0.0
    read, true = np.array(pairs).T
    columns = np.stack([read, np.full(len(read), LEVELS[-1] / 2)])
    # Both unknowns in points at half scale, so that one prior suits slope and offset.
    residual = columns @ (true - read)
    slope, offset = np.linalg.solve(columns @ columns.T + _LINE_PRIOR * np.eye(2), residual)
    return float(max(1 + slope, _LEAST)), float(offset * LEVELS[-1] / 2)


def _moved(estimate: Estimate, lines: dict[str, tuple[float, float]]) -> NDArray[np.float64]:
    """Return (11,) the probabilities after each kind's share has moved on its line.

    What falls between two levels goes to both, by nearness; level 0 stays what it is.
    """
    moved = np.zeros(_N)
    for kind, weight in estimate.kind_probabilities.items():
        slope, offset = lines.get(kind, (1.0, 0.0))
        places = np.clip(slope * LEVELS + offset, 0.0, LEVELS[-1])
        places[0] = 0.0
        nearness = np.maximum(1 - np.abs(places - LEVELS[:, np.newaxis]) / LEVELS[1], 0)
        moved += weight * nearness @ estimate.probabilities
    return moved


def _scaling(
    probabilities: NDArray[np.float64], levels: Sequence[float]
) -> tuple[float, tuple[float, ...]]:
    """Return exponent and offsets: Newton's method on a convex loss.

    The loss is the surprise at the true levels, plus a little weight on the identity.
    """
    logs = _logs(probabilities)
    truth = np.eye(_N)[np.searchsorted(LEVELS, levels)]
    identity = np.concatenate([[1.0], np.zeros(_N)])
    # Derivative of the eleven logits by exponent and offsets, (n, 11, 12).
    slopes = np.concatenate([logs[..., np.newaxis], np.tile(np.eye(_N), (len(logs), 1, 1))], axis=2)
    point = identity
    loss = _loss(point, identity, slopes, truth)
    for _ in range(_ROUNDS):
        answer = _softmax(slopes @ point)
        gradient = np.einsum("nl,nlp->p", answer - truth, slopes) + _PRIOR * (point - identity)
        weighted = slopes * answer[..., np.newaxis]
        means = weighted.sum(axis=1)
        curvature = np.einsum("nlp,nlq->pq", weighted, slopes) - means.T @ means
        step = np.linalg.solve(curvature + _PRIOR * np.eye(_N + 1), gradient)
        # Halve the step until the loss falls: Newton's may overshoot far from the minimum.
        while (ahead := _loss(point - step, identity, slopes, truth)) > loss:
            step = step / 2
            if np.abs(step).max() < _CONVERGED:
                break
        point, loss = point - step, min(loss, ahead)
        if np.abs(step).max() < _CONVERGED:
            break
    return float(max(point[0], _LEAST)), tuple(point[1:].tolist())


def _loss(
    point: NDArray[np.float64],
    identity: NDArray[np.float64],
    slopes: NDArray[np.float64],
    truth: NDArray[np.float64],
) -> float:
    surprise = -np.log(np.maximum((_softmax(slopes @ point) * truth).sum(axis=1), 1e-300)).sum()
    return float(surprise + _PRIOR / 2 * ((point - identity) ** 2).sum())


def _logs(probabilities: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.log(np.maximum(probabilities, _LEAST)))


def _softmax(logits: NDArray[np.float64]) -> NDArray[np.float64]:
    exponential = np.exp(logits - logits.max(axis=-1, keepdims=True))
    return np.asarray(exponential / exponential.sum(axis=-1, keepdims=True))
