"""What sticks to a camera's lens: drops and dirt, told by what stands still while the scene moves.

Four times a second a coarse map of a frame is taken: log detail and log brightness in cells that
are 1/64 of the frame's height wide, of bands of eight rows. Averaged over seconds the scene evens
out, and what sticks to the lens remains. A small convolutional network reads the averages and how
much each cell varied, and says how likely each kind and level makes them, against a clean lens.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from dbc.errors import ModelError
from models.estimate.level import LENS_KINDS, LEVELS
from models.estimate.network import WEIGHTS, open_network

VERSION = 1
"""Version of the input; raised whenever its meaning changes."""
LOOK_EVERY_S = 0.25
"""Time from one look at the lens to the next, s."""
LONGEST_GAP_S = 1.0
"""Time without a look after which the lens may be another, s."""
TIME_CONSTANT_S = 3.0
"""Of the averages, s: shorter than a drop stays, longer than the scene takes to pass a cell."""
BANDS = 16
"""Bands of rows, and rows of the map."""
CHANNELS = 5
"""Of the network's input: averages of log detail and of log brightness, their standard deviations
in time, and the logarithm of the time since the first look, 9 s at most."""

LOG_RATIOS = (len(LENS_KINDS), len(LEVELS) - 1)
"""Shape of the network's output: kinds, and levels from 10 % on."""

_ROWS = 8
_CELLS_A_HEIGHT = 64
_CELLS = 16, 256
_DETAIL_FLOOR = 0.05
_BRIGHTNESS_FLOOR = 2.0
_FIRST_AGE_S = 0.2
_LONGEST_AGE_S = 3 * TIME_CONSTANT_S  # what is older hardly counts any more

Map = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class LensHistory:
    """What a camera's lens looked like in the last seconds.

    Attributes
    ----------
    began_ns, stamp_ns:
        Moments of capture of the first and of the newest frame that was looked at, integer
        nanoseconds.
    size:
        Height and width of its frames, pixels.
    averages:
        (4, 16, columns) float32: log detail, log brightness, and their squares, averaged over the
        time since the beginning, of which ``TIME_CONSTANT_S`` counts.
    """

    began_ns: int
    stamp_ns: int
    size: tuple[int, int]
    averages: Map

    @classmethod
    def begin(cls, stamp_ns: int, image: NDArray[np.uint8]) -> Self:
        """Return the history of one frame; see ``lens_cells``."""
        return cls(stamp_ns, stamp_ns, _size(image), _with_squares(lens_cells(image)))

    def after(self, stamp_ns: int, image: NDArray[np.uint8]) -> LensHistory:
        """Return the history with the next frame.

        A frame that comes less than ``LOOK_EVERY_S`` after the newest, or late, changes nothing.
        After ``LONGEST_GAP_S`` without a look, where the clock was set back by as much, or where
        the frame has another size, a new history begins.

        The weights are those of an average that fades as exp(−Δt/τ) and began with the history, so
        that its beginning counts no more than what came later.
        """
        elapsed_s = (stamp_ns - self.stamp_ns) * 1e-9
        if _size(image) != self.size or abs(elapsed_s) > LONGEST_GAP_S:
            return LensHistory.begin(stamp_ns, image)
        if elapsed_s < LOOK_EVERY_S:
            return self
        filled = -math.expm1(-(self.age_s + 2 * elapsed_s) / TIME_CONSTANT_S)
        weight = np.float32(-math.expm1(-elapsed_s / TIME_CONSTANT_S) / filled)
        newest = _with_squares(lens_cells(image))
        averages = self.averages + weight * (newest - self.averages)
        return LensHistory(self.began_ns, stamp_ns, self.size, averages)

    @property
    def age_s(self) -> float:
        """Time from the first frame to the newest, s."""
        return (self.stamp_ns - self.began_ns) * 1e-9


def _size(image: NDArray[np.uint8]) -> tuple[int, int]:
    height, width = image.shape[:2]
    return height, width


def _with_squares(cells: Map) -> Map:
    return np.concatenate([cells, cells * cells])


def lens_cells(image: NDArray[np.uint8]) -> Map:
    """Return log detail and log brightness of a frame's cells.

    Parameters
    ----------
    image:
        (height, width, 3) uint8 BGR of any size from 1×1 up.

    Returns
    -------
    (2, 16, columns) float32: log of the mean difference between neighbours along rows, and log2 of
    the mean, of green, counts.
    """
    height, width = image.shape[:2]
    rows = min(_ROWS, height)
    tops = np.clip((np.arange(BANDS) + 0.5) * height / BANDS - rows / 2, 0, height - rows)
    green = np.empty((BANDS * rows, width), np.uint8)
    for band, top in zip(np.split(green, BANDS), tops.astype(int).tolist(), strict=True):
        cv2.extractChannel(image[top : top + rows], 1, band)
    neighbours = (green[:, 1:], green[:, :-1]) if width > 1 else (green, green)
    difference = np.asarray(cv2.absdiff(*neighbours), np.uint8)
    columns = int(np.clip(round(_CELLS_A_HEIGHT * width / height), *_CELLS))
    return np.stack(
        [
            np.log(_means(difference, columns) + np.float32(_DETAIL_FLOOR)),
            np.log2(_means(green, columns) + np.float32(_BRIGHTNESS_FLOOR)),
        ]
    )


def _means(bands: NDArray[np.uint8], columns: int) -> Map:
    in_bands = bands.reshape(BANDS, -1, bands.shape[1])
    down = in_bands.sum(axis=1, dtype=np.uint16).astype(np.float32) / np.float32(in_bands.shape[1])
    return np.asarray(cv2.resize(down, (columns, BANDS), interpolation=cv2.INTER_AREA), np.float32)


def lens_input(history: LensHistory) -> Map:
    """Return the network's input, (5, 16, columns) float32; see ``CHANNELS``."""
    means, squares = history.averages[:2], history.averages[2:]
    spread = np.sqrt(np.maximum(squares - means * means, 0))
    age_s = min(history.age_s, _LONGEST_AGE_S)
    age = np.full_like(means[:1], math.log(age_s + _FIRST_AGE_S))
    return np.concatenate([means, spread, age])


class LensNetwork:
    """Reads the history of a camera's lens; safe to share between threads.

    Parameters
    ----------
    path:
        A network made by ``murk train lens``; the one that murk ships when None.

    Raises
    ------
    ModelError
        If the file is missing, corrupt or not a lens network of this version.
    """

    def __init__(self, path: Path | None = None) -> None:
        path = path or WEIGHTS / "lens.onnx"
        self._session = open_network(path, model="lens", version=VERSION)
        found = {
            node.name: list(node.shape)
            for node in (*self._session.get_inputs(), *self._session.get_outputs())
        }
        shapes = {name: [n if isinstance(n, int) else 0 for n in found[name]] for name in found}
        expected = {"lens": [1, CHANNELS, BANDS, 0], "log_ratios": [1, *LOG_RATIOS]}
        if shapes != expected:
            raise ModelError(path, f"has inputs and outputs {shapes}", f"expected {expected}")

    def log_ratios(self, history: LensHistory) -> NDArray[np.float64]:
        """Return how likely each kind and level makes what was seen, against a clean lens.

        Returns
        -------
        (2, 10) float64: natural logarithms, by ``LENS_KINDS`` and by levels from 10 % on.
        """
        (ratios,) = self._session.run(["log_ratios"], {"lens": lens_input(history)[np.newaxis]})
        return np.asarray(ratios[0], np.float64)
