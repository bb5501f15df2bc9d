"""Faults of a camera and its link, each with a rate in % of the frames, repeatable by its seed.

=======  ==================================================================================
fault    what it does
=======  ==================================================================================
frozen   the last picture comes again under a new stamp
black    the picture is all 0
torn     above a line the picture is the new one, below it still the last one
late     it comes up to 200 ms late, and those behind it wait for it
dropped  it does not come
=======  ==================================================================================

What is hit depends on nothing but seed, sensor and sequence of the frame; and what a rate hits is
hit by every higher rate too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.frame import Frame
from models.degrade.draw import DrawKey

CAMERA_FAULTS = ("frozen", "black", "torn", "late", "dropped")

LONGEST_DELAY_NS = 200_000_000


class CameraFaults:
    """The faults of one camera, frame by frame.

    Parameters
    ----------
    sensor, seed:
        With the sequence of the frame, all that the draws depend on.

    Attributes
    ----------
    counts:
        Frames hit so far, by fault.
    """

    def __init__(self, sensor: str, seed: int) -> None:
        self.counts: Counter[str] = Counter()
        self._sensor = sensor
        self._seed = seed
        self._last: NDArray[np.uint8] | None = None

    def apply(self, frame: Frame, rates: Mapping[str, float]) -> tuple[Frame | None, int]:
        """Return what becomes of a frame.

        Parameters
        ----------
        rates:
            Rate in % by fault; one that is missing is 0.

        Returns
        -------
        The frame, None where it does not come; and how late it comes, nanoseconds.
        """
        image, last = frame.image, self._last
        if last is not None and last.shape != image.shape:
            last = None
        if last is not None and self._hits("frozen", rates, frame):
            image = last
        if self._hits("black", rates, frame):
            image = np.zeros_like(image)
        if last is not None and self._hits("torn", rates, frame):
            line = int(self._place("torn", frame) * len(image))
            image = np.concatenate([image[:line], last[line:]])
        self._last = image
        late_ns = 0
        if self._hits("late", rates, frame):
            late_ns = int(self._place("late", frame) * LONGEST_DELAY_NS)
        if self._hits("dropped", rates, frame):
            return None, 0
        return replace(frame, image=image), late_ns

    def _hits(self, fault: str, rates: Mapping[str, float], frame: Frame) -> bool:
        rate = rates.get(fault, 0)
        hit = rate > 0 and bool(self._generator(fault, frame).random() < rate / 100)
        if hit:
            self.counts[fault] += 1
        return hit

    def _place(self, fault: str, frame: Frame) -> float:
        return float(self._generator(f"{fault} where", frame).random())

    def _generator(self, purpose: str, frame: Frame) -> np.random.Generator:
        key = DrawKey(self._seed, self._sensor, frame.sequence)
        return key.generator(f"camera fault {purpose}")
