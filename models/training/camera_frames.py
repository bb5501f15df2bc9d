"""Training samples of the camera's network: varied clean frames, degraded as the product does.

Most of them by one of the main kinds, the rest by two kinds at once, by one of those that come
about outside the camera, or by one of the further kinds. Some are compressed afterwards, as a
camera's stream is; of these more are clean than of the rest, lest compression be taken for
degradation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from models.degrade.camera import Method
from models.degrade.draw import DrawKey
from models.estimate.image_features import image_features
from models.estimate.level import FRAME_KINDS, IMAGE_KINDS, LEVELS, OUTER_KINDS
from models.evaluate.camera import COMBINED, MAIN_KINDS, CleanFrame, clean_frames, degrade
from models.evaluate.codecs import Image, gray, one_channel
from models.training.camera_vary import compress, sense, vary, without_evidence

FURTHER_KINDS = tuple(kind for kind in IMAGE_KINDS[1:] if kind not in (*MAIN_KINDS, *OUTER_KINDS))

DEGRADED_PER_FRAME = 10
_QUICK_FRAMES = 12
_SHARE_OF_LEVELS_BETWEEN = 0.15
_SHARE_WITHOUT_EVIDENCE = 0.04
_SHARE_GRAY = 0.06
_LEVELS_OF_NOTHING = np.array([0.0, *np.repeat(LEVELS[1:], 40)])
"""Seldom clean: the odds of a clean frame are raised later, and say nothing where nothing shows."""
_SHARE_EXACT = 0.25
_SHARE_CLEAN_OF_COMPRESSED = 0.25


@dataclass(frozen=True, slots=True)
class Recipe:
    """Shares of the samples by what is done to them; the rest is degraded by a further kind.

    Attributes
    ----------
    main, combined, outer:
        Degraded by a main kind, by two kinds at once, and by a kind of ``OUTER_KINDS``.
    compressed:
        Compressed after they were degraded, whatever the kind.
    """

    main: float = 0.58
    combined: float = 0.08
    outer: float = 0.22
    compressed: float = 0.12


MAIN_ONLY = Recipe(main=1.0, combined=0.0, outer=0.0, compressed=0.0)
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
        Index into ``FRAME_KINDS``, (n,).
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


def read_splits(data: Path, names: Sequence[str], *, quick: bool) -> dict[str, list[CleanFrame]]:
    """Return the clean frames of some splits; a few of each where it must be quick.

    Raises
    ------
    InputError
        If the data lack something.
    """
    splits = {name: clean_frames(data, name) for name in names}
    if not quick:
        return splits
    return {
        name: frames[:: max(1, len(frames) // _QUICK_FRAMES)] for name, frames in splits.items()
    }


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
        shows_nothing = rng.random() < _SHARE_WITHOUT_EVIDENCE
        if shows_nothing:
            clean = without_evidence(rng)
        else:
            clean = vary(frame.read(), frame.read_repaired(), rng)
        is_gray = rng.random() < _SHARE_GRAY
        if is_gray:
            clean = gray(clean)
        for _ in range(DEGRADED_PER_FRAME):
            compressed = rng.random() < recipe.compressed
            if compressed and not shows_nothing and rng.random() < _SHARE_CLEAN_OF_COMPRESSED:
                kind, level, image = "clean", 0.0, clean
            else:
                among = _LEVELS_OF_NOTHING if shows_nothing else LEVELS
                kind, level, image = _degrade(clean, among, recipe, rng)
            if is_gray:
                image = one_channel(image)
            if shows_nothing and rng.random() < 0.5:
                image = sense(image, rng)
            if compressed:
                image = compress(image, rng)
            features.append(describe(image))
            levels.append(level)
            kinds.append(FRAME_KINDS.index(kind))
    return Samples(np.array(features), np.array(levels, np.float32), np.array(kinds))


def _degrade(
    clean: Image, levels: NDArray[np.float64], recipe: Recipe, rng: np.random.Generator
) -> tuple[str, float, Image]:
    kinds = _draw_kinds(recipe, rng.random())
    kind = kinds[int(rng.integers(len(kinds)))]
    between = rng.random() < _SHARE_OF_LEVELS_BETWEEN
    level = rng.uniform(0, 100) if between else float(rng.choice(levels))
    key = DrawKey(int(rng.integers(2**31)), "training", 0)
    method: Method = "exact" if rng.random() < _SHARE_EXACT else "fast"
    true_kind, image = degrade(kind, level, key, clean, method)
    return true_kind, level, image


def _draw_kinds(recipe: Recipe, share: float) -> Sequence[str]:
    """Return the group of kinds that a uniform number below 1 falls on."""
    for part, kinds in (
        (recipe.main, MAIN_KINDS),
        (recipe.combined, COMBINED),
        (recipe.outer, OUTER_KINDS),
    ):
        if share < part:
            return kinds
        share -= part
    return FURTHER_KINDS
