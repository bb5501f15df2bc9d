"""What arrives at the radar, what falls into a resolution cell, and what was measured."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from models.world.objects import Floats


class Motion(IntEnum):
    """How a reflector moves over ground."""

    STANDING = 0
    MOVING = 1
    CROSSING = 2
    STOPPED = 3
    MIRRORED = 4
    """Not there at all: the wave went to and fro twice."""


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """What arrives at the radar from N reflectors, (N,) each unless said.

    Attributes
    ----------
    r, azimuth, speed:
        m, rad, m/s (radial, approaching negative).
    amplitude:
        Square root of the mean radar cross section in m².
    steady:
        Share of the power that does not fluctuate.
    turn:
        (N, waves) phases of the waves that the fluctuating share is made of, rad.
    motion:
        uint8, ``Motion`` over ground.
    chance:
        Unchanging number of the reflector, uniform on [0, 1), by which the sensor judges it.
    """

    r: Floats
    azimuth: Floats
    speed: Floats
    amplitude: Floats
    steady: Floats
    turn: Floats
    motion: NDArray[np.uint8]
    chance: Floats

    def __getitem__(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> Points:
        return Points(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Resolution cells with what came back from each, (n,) each; as ``Points`` where not said.

    Attributes
    ----------
    field:
        complex128, sum over the cell's reflectors, square root of m².
    """

    r: Floats
    azimuth: Floats
    speed: Floats
    field: NDArray[np.complex128]
    motion: NDArray[np.uint8]
    chance: Floats

    def __getitem__(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> Cells:
        return Cells(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(frozen=True, slots=True, eq=False)
class Echoes:
    """What one scan measured, sorted by range; (n,) each.

    Attributes
    ----------
    r, azimuth, speed:
        As measured: m, rad, m/s (radial, approaching negative).
    rcs, snr:
        dBm², dB.
    shoulder:
        dB by which the strongest echo beside it is stronger; 0 where none is.
    rivalry:
        dB by which the strongest echo of another direction in the same range and Doppler bin is
        stronger; −inf where there is none.
    motion, chance:
        As of the strongest reflector in the cell.
    """

    r: Floats
    azimuth: Floats
    speed: Floats
    rcs: Floats
    snr: Floats
    shoulder: Floats
    rivalry: Floats
    motion: NDArray[np.uint8]
    chance: Floats

    def __len__(self) -> int:
        return len(self.r)

    def __getitem__(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> Echoes:
        return Echoes(*(getattr(self, field.name)[which] for field in fields(self)))

    def confirmed_by(self, other: Echoes) -> NDArray[np.bool_]:
        """Return which echoes the other scan has too, within 1.5 m and 2°."""
        gap = np.abs(self.r[:, None] - other.r) / 1.5
        turn = np.abs(self.azimuth[:, None] - other.azimuth) / np.radians(2.0)
        return np.asarray((np.maximum(gap, turn) < 1).any(axis=1))
