"""Training samples of the camera's network: varied clean frames, degraded as the product does.

Most of them by one of the main kinds, the rest by two kinds at once or by one of the further
kinds. Some are compressed afterwards, as a camera's stream is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from models.degrade.camera import Method
from models.degrade.draw import DrawKey
from models.estimate.image_features import image_features
from models.estimate.level import CAMERA_KINDS, LEVELS
from models.evaluate.camera import COMBINED, MAIN_KINDS, degrade
from models.evaluate.codecs import Image
from models.training.camera_vary import compress, vary, without_evidence

FURTHER_KINDS = tuple(kind for kind in CAMERA_KINDS[1:] if kind not in MAIN_KINDS)

DEGRADED_PER_FRAME = 10
_SHARE_OF_LEVELS_BETWEEN = 0.15
_SHARE_WITHOUT_EVIDENCE = 0.03


@dataclass(frozen=True, slots=True)
class Recipe:
    """Shares of the samples by what is done to them; the rest is degraded by a further kind.

    Attributes
    ----------
    main, combined:
        Degraded by a main kind, and by two kinds at once.
    compressed:
        Compressed after they were degraded, whatever the kind.
    """

    main: float = 0.75
    combined: float = 0.06
    compressed: float = 0.05


MAIN_ONLY = Recipe(main=1.0, combined=0.0, compressed=0.0)
"""What networks are trained on that shall know nothing but the main kinds."""


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Training samples.

    Attributes
    ----------
    features:
        (n, number of features), float32 where ``image_features`` made them.
    levels:
        True level, %, (n,); also between the eleven.
    kinds:
        Index into ``CAMERA_KINDS``, (n,).
    """

    features: NDArray[Any]
    levels: NDArray[np.float32]
    kinds: NDArray[np.int64]


class Clean(Protocol):
    """A frame without degradation: real, or simulated."""

    @property
    def name(self) -> str:
        """What tells it from other frames."""
        ...

    def read(self) -> Image:
        """Return the image."""
        ...

    def read_repaired(self) -> Image | None:
        """Return the mask of pixels that somebody painted over, or None."""
        ...


def make_samples(
    frames: Sequence[Clean],
    passes: int,
    seed: int,
    recipe: Recipe = Recipe(),
    describe: Callable[[Image], NDArray[Any]] = image_features,
) -> Samples:
    """Return ``DEGRADED_PER_FRAME`` samples of every frame in every pass, each varied anew.

    They depend on the arguments only, not on the number of processors that share the passes.

    Parameters
    ----------
    describe:
        Returns the features of an image; a function of a module, since other processes call it.
    """
    one_pass = partial(_make_pass, frames, seed, recipe, describe)
    if passes == 1:
        return one_pass(0)
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        parts = list(pool.map(one_pass, range(passes)))
    return join(parts)


def join(parts: Sequence[Samples]) -> Samples:
    """Return several samples as one."""
    return Samples(
        np.concatenate([part.features for part in parts]),
        np.concatenate([part.levels for part in parts]),
        np.concatenate([part.kinds for part in parts]),
    )


def _make_pass(
    frames: Sequence[Clean],
    seed: int,
    recipe: Recipe,
    describe: Callable[[Image], NDArray[Any]],
    turn: int,
) -> Samples:
    cv2.setNumThreads(1)
    features, levels, kinds = [], [], []
    for frame in frames:
        rng = DrawKey(seed, frame.name, turn).generator("variation")
        if rng.random() < _SHARE_WITHOUT_EVIDENCE:
            clean = without_evidence(rng)
        else:
            clean = vary(frame.read(), frame.read_repaired(), rng)
        for _ in range(DEGRADED_PER_FRAME):
            kind, level, image = _degrade(clean, recipe, rng)
            features.append(describe(image))
            levels.append(level)
            kinds.append(CAMERA_KINDS.index(kind))
    return Samples(np.array(features), np.array(levels, np.float32), np.array(kinds))


def _degrade(clean: Image, recipe: Recipe, rng: np.random.Generator) -> tuple[str, float, Image]:
    share = rng.random()
    kinds: Sequence[str] = FURTHER_KINDS
    if share < recipe.main:
        kinds = MAIN_KINDS
    elif share < recipe.main + recipe.combined:
        kinds = COMBINED
    kind = kinds[int(rng.integers(len(kinds)))]
    between = rng.random() < _SHARE_OF_LEVELS_BETWEEN
    level = rng.uniform(0, 100) if between else float(rng.choice(LEVELS))
    key = DrawKey(int(rng.integers(2**31)), "training", 0)
    method: Method = "exact" if rng.random() < 0.5 else "fast"
    true_kind, image = degrade(kind, level, key, clean, method)
    if rng.random() < recipe.compressed:
        image = compress(image, rng)
    return true_kind, level, image
