"""What a frame shows in each place of a coarse map: fog lies on the horizon, dirt on a part."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

PLACES = (5, 6, 12)
"""Shape of what ``places`` returns: measures, and rows and columns of the map."""
LOG_DETAIL = 1
"""The measure that is log detail."""
FLOOR = 0.01
"""Added before logs, counts or counts²: well under the 1/12 count² of rounding to 8 bit."""


def places(planes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return what is in each place, (5, 72).

    Brightness, log detail, the darkest and the brightest of any channel, and how far the channels
    are apart.

    Parameters
    ----------
    planes:
        (3, height, width) uint8, BGR.
    """
    green = planes[1]
    detail = np.asarray(cv2.absdiff(green[:, 1:], green[:, :-1]), np.uint8)
    darkest = cv2.min(cv2.min(planes[0], green), planes[2])
    brightest = cv2.max(cv2.max(planes[0], green), planes[2])
    return np.array(
        [
            brightness_of(planes),
            np.log(means(detail) + FLOOR),
            _ends(darkest, np.minimum) / 255,
            _ends(brightest, np.maximum) / 255,
            np.log(means(cv2.subtract(brightest, darkest)) + 1),
        ],
        np.float32,
    )


def brightness_of(planes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the brightness of each place, 0 to 1, (72,), of planes as ``places`` takes them."""
    return means(planes[1]) / np.float32(255)


def means(plane: MatLike) -> NDArray[np.float32]:
    """Return the mean of a plane (height, width) in each place, (72,)."""
    down = [cv2.reduce(part, 0, cv2.REDUCE_AVG, dtype=cv2.CV_32F) for part in _down(plane)]
    lefts, widths = _columns(plane.shape[1])
    return np.ravel(np.add.reduceat(np.concatenate(down), lefts, axis=1) / widths)


def _ends(plane: MatLike, of: np.ufunc) -> NDArray[np.float32]:
    """Return the least or the greatest of each place, (72,)."""
    down = [of.reduce(part, axis=0) for part in _down(plane)]
    lefts, _ = _columns(plane.shape[1])
    return np.ravel(of.reduceat(np.array(down), lefts, axis=1)).astype(np.float32)


def _down(plane: MatLike) -> list[MatLike]:
    """Return the rows of each of the places one below the other, at least one row each."""
    rows = PLACES[1]
    tops = [row * len(plane) // rows for row in range(rows + 1)]
    return [plane[top : max(top + 1, after)] for top, after in pairwise(tops)]


@lru_cache(maxsize=16)
def _columns(width: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where each of the places side by side begins, and how wide it is."""
    columns = PLACES[2]
    edges = np.arange(columns + 1) * width // columns
    return edges[:-1], np.diff(edges)
