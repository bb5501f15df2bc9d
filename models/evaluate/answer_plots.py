"""Plots of what an estimator answered: confusion of the levels, and whether it knows how sure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from models.estimate.level import LEVELS
from models.evaluate.report import Picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BINS = 10
_WHITE_FROM = 0.6


def confusion_picture(title: str, confusion: NDArray[np.intp]) -> Picture:
    """Return the plot of how often each true level (rows) was taken for each level, (11, 11)."""

    def draw(figure: Figure) -> None:
        axis = figure.subplots()
        shares = confusion / np.maximum(confusion.sum(axis=1, keepdims=True), 1)
        axis.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        for row, column in zip(*np.nonzero(confusion), strict=True):
            colour = "white" if shares[row, column] > _WHITE_FROM else "black"
            count = str(confusion[row, column])
            axis.text(column, row, count, ha="center", va="center", size=8, color=colour)
        names = [f"{level:g}" for level in LEVELS]
        axis.set_xticks(range(len(names)), names)
        axis.set_yticks(range(len(names)), names)
        axis.set_xlabel("most probable level, %")
        axis.set_ylabel("true level, %")

    return Picture(title, draw)


def expected_calibration_error(
    probabilities: NDArray[np.float64], levels: NDArray[np.float64]
) -> float:
    """Return by how much the confidence is off on average, 0 to 1.

    The most probable level's probability against how often it is the true level, in ten bins of
    equal width, weighted by their answers (Guo et al., "On calibration of modern neural networks",
    ICML 2017).

    Parameters
    ----------
    probabilities:
        (n, 11) over ``LEVELS``.
    levels:
        (n,) the true ones, %.
    """
    counts, confidence, right = reliability(probabilities, levels)
    return float(np.abs(confidence - right) @ counts / counts.sum())


def reliability_picture(
    title: str, probabilities: NDArray[np.float64], levels: NDArray[np.float64]
) -> Picture:
    """Return the plot of the share of right answers over the confidence; see above."""
    return bins_picture(title, *reliability(probabilities, levels))


def bins_picture(
    title: str,
    counts: NDArray[np.intp],
    confidence: NDArray[np.float64],
    right: NDArray[np.float64],
) -> Picture:
    """Return the same plot of the bins that ``reliability`` returns."""

    def draw(figure: Figure) -> None:
        axis = figure.subplots()
        axis.plot([0, 1], [0, 1], color="0.7", linestyle=":")
        axis.scatter(confidence, right, s=20 + 400 * counts / counts.sum())
        for count, x, y in zip(counts, confidence, right, strict=True):
            axis.annotate(f"{count}", (x, y), xytext=(9, -9), textcoords="offset points", size=8)
        axis.set_xlabel("probability of the most probable level")
        axis.set_ylabel("share in which it is the true one")
        axis.set_xlim(0, 1.02)
        axis.set_ylim(0, 1.02)
        axis.spines[["top", "right"]].set_visible(False)

    return Picture(title, draw)


def reliability(
    probabilities: NDArray[np.float64], levels: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """Return count, mean confidence and share of right answers of every bin that is not empty."""
    confidence = probabilities.max(axis=1)
    right = LEVELS[probabilities.argmax(axis=1)] == levels
    index = np.minimum((confidence * _BINS).astype(int), _BINS - 1)
    counts = np.bincount(index, minlength=_BINS)
    filled = counts > 0
    sums = [np.bincount(index, weights=values, minlength=_BINS) for values in (confidence, right)]
    means = [total[filled] / counts[filled] for total in sums]
    return counts[filled], means[0], means[1]
