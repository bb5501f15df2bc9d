"""Frames of the simulated world, to train on beside the real ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from models.world.camera import WorldCamera
from models.world.road import World

_FIRST_SEED = 1_000_000  # far from the seeds that people type: a demonstration shows new worlds
_DURATION_S = 20.0


@dataclass(frozen=True, slots=True)
class SimulatedFrame:
    """One frame of one simulated drive; rendered when read."""

    seed: int
    sequence: int

    @property
    def name(self) -> str:
        """What tells it from other frames."""
        return f"simulated {self.seed} {self.sequence}"

    def read(self) -> NDArray[np.uint8]:
        """Return the image, (height, width, 3) uint8 BGR."""
        return _render(self.seed, self.sequence)

    def read_repaired(self) -> None:
        """Return None: no pixel was repaired."""
        return


@cache
def _render(seed: int, sequence: int) -> NDArray[np.uint8]:
    """Return a frame; kept, since every pass over the frames reads each again."""
    return _camera(seed).frame(sequence).image


@cache
def _camera(seed: int) -> WorldCamera:
    return WorldCamera(World(seed, _DURATION_S))


def simulated_frames(worlds: int, frames_each: int) -> list[SimulatedFrame]:
    """Return frames spread evenly over each of some drives."""
    last = int(_DURATION_S * 12.5) - 1
    sequences = np.linspace(0, last, frames_each).astype(int).tolist()
    return [
        SimulatedFrame(_FIRST_SEED + world, sequence)
        for world in range(worlds)
        for sequence in sequences
    ]
