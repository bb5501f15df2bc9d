"""The counter-based generator from which every degradation draws its parameters."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class DrawKey:
    """What a draw depends on, and nothing else: not threads, not order, not time.

    Attributes
    ----------
    seed:
        The run's seed.
    sensor:
        The sensor's name.
    sequence:
        The message's sequence number.
    """

    seed: int
    sensor: str
    sequence: int

    def generator(self, purpose: str) -> np.random.Generator:
        """Return the generator of this key for one purpose (two purposes are independent).

        Philox (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011), keyed by
        a digest, so that keys that differ in one bit give unrelated streams.
        """
        text = f"{self.seed}\0{self.sensor}\0{self.sequence}\0{purpose}".encode()
        digest = hashlib.blake2b(text, digest_size=16).digest()
        return np.random.Generator(np.random.Philox(key=int.from_bytes(digest, "little")))
