"""Accuracy of a camera estimator on real frames, degraded at known levels."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from drivers.images import read_image
from models.degrade.camera import KINDS, Method, apply, draw
from models.degrade.draw import DrawKey
from models.degrade.kinds import module_of
from models.estimate.level import CAMERA_KINDS, LEVELS, Estimate

Image = NDArray[np.uint8]

MAIN_KINDS = KINDS
"""Kinds of the four that the goals are set for: blur, over, under, noise."""
COMBINED = ("under+noise", "blur+noise")
"""Kinds that come together: the light fails and the sensor is noisy, or the focus fails."""
TUNNEL_PERIOD = 100
"""Frames from one mouth of an injected tunnel to the next: out into the light, into the dark."""
TUNNEL_FRAMES = 24
"""From a tunnel's mouth until 95 % of its transient is over: three time constants."""


@dataclass(frozen=True, slots=True)
class CleanFrame:
    """One undegraded frame of the data.

    Attributes
    ----------
    path:
        The image.
    mask:
        Image of the same size, non-zero where pixels were repaired; it may not exist.
    scene, source, licence, condition, weather:
        Where it comes from, its terms, the time of day and the weather.
    restricted:
        True where the licence allows research or non-commercial use only.
    certain:
        False where it was sharpened or is soft, so that level 0 is true with care only.
    """

    path: Path
    mask: Path
    scene: str
    source: str
    licence: str
    condition: str
    weather: str
    restricted: bool
    certain: bool

    @property
    def name(self) -> str:
        """What tells it from other frames."""
        return self.path.name

    def read_repaired(self) -> Image | None:
        """Return the mask of repaired pixels, or None where there is none."""
        return read_image(self.mask)

    def read(self) -> Image:
        """Return the image, (height, width, 3) uint8 BGR.

        Raises
        ------
        InputError
            If it cannot be read.
        """
        image = read_image(self.path)
        if image is None:
            raise InputError(self.path, "cannot be read", "an image that index.csv names")
        return image


def clean_frames(data: Path, split: str) -> list[CleanFrame]:
    """Return the frames of a split that may serve as level 0, in the order of ``index.csv``.

    Parameters
    ----------
    data:
        Folder with ``camera/index.csv``.
    split:
        ``train``, ``val`` or ``test``; the scenes of one are in no other.

    Raises
    ------
    InputError
        If there is no such index, or no such frame in it.
    """
    folder = data / "camera"
    index = folder / "index.csv"
    try:
        rows = list(csv.DictReader(index.read_text(encoding="utf-8").splitlines()))
        frames = [
            CleanFrame(
                path=folder / row["file"],
                mask=folder / "masks" / f"{Path(row['file']).stem}.png",
                scene=row["scene"],
                source=row["source"].split(":")[0],
                licence=row["licence"],
                condition=row["timeofday"],
                weather=row.get("weather") or "?",
                restricted=row.get("licence_class") == "B",
                certain=float(row["clean"]) == 1,
            )
            for row in rows
            if row["split"] == split and float(row["clean"]) > 0
        ]
    except OSError as error:
        raise InputError(index, error.strerror or "cannot be read", "a list of frames") from None
    except (KeyError, ValueError) as error:
        raise InputError(index, f"no list of frames ({error})", "split, file, clean, …") from None
    if not frames:
        raise InputError(index, f"has no clean frame of split {split}")
    return frames


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What an estimator answered to n degraded frames.

    Attributes
    ----------
    kinds, levels:
        The truth: index into ``CAMERA_KINDS`` and level in %, (n,) each.
    frames:
        Index of the clean frame, (n,).
    probabilities, kind_probabilities:
        The answers, (n, 11) and (n, number of kinds).
    """

    kinds: NDArray[np.intp]
    levels: NDArray[np.float64]
    frames: NDArray[np.intp]
    probabilities: NDArray[np.float64]
    kind_probabilities: NDArray[np.float64]

    @property
    def hits(self) -> NDArray[np.bool_]:
        """Whether the most probable level is the true one, (n,)."""
        return np.asarray(LEVELS[self.probabilities.argmax(axis=1)] == self.levels)

    @property
    def errors(self) -> NDArray[np.float64]:
        """Distance of the mean level from the true one, points, (n,)."""
        return np.asarray(np.abs(self.probabilities @ LEVELS - self.levels))

    def confusion(self) -> NDArray[np.intp]:
        """Return how often each true level (rows) was taken for each level, (11, 11)."""
        table = np.zeros((len(LEVELS), len(LEVELS)), np.intp)
        truth = np.searchsorted(LEVELS, self.levels)
        np.add.at(table, (truth, self.probabilities.argmax(axis=1)), 1)
        return table

    def kind_confusion(self) -> NDArray[np.intp]:
        """Return how often each true kind (rows) was taken for each, (kinds, kinds)."""
        table = np.zeros((len(CAMERA_KINDS), len(CAMERA_KINDS)), np.intp)
        np.add.at(table, (self.kinds, self.kind_probabilities.argmax(axis=1)), 1)
        return table

    def table(self) -> dict[str, dict[str, float]]:
        """Return, over all and by true kind: count, accuracies, and mean error in points."""
        groups = {"all": np.ones(len(self.kinds), bool)}
        groups |= {kind: self.kinds == index for index, kind in enumerate(CAMERA_KINDS)}
        return {name: self._row(group) for name, group in groups.items() if group.any()}

    def among(self, group: NDArray[np.bool_]) -> Answers:
        """Return the answers that a mask (n,) selects."""
        return Answers(
            self.kinds[group],
            self.levels[group],
            self.frames[group],
            self.probabilities[group],
            self.kind_probabilities[group],
        )

    def _row(self, group: NDArray[np.bool_]) -> dict[str, float]:
        kind_hits = self.kind_probabilities[group].argmax(axis=1) == self.kinds[group]
        return {
            "count": int(group.sum()),
            "accuracy": float(self.hits[group].mean()),
            "mean_error": float(self.errors[group].mean()),
            "kind_accuracy": float(kind_hits.mean()),
        }


def tunnel_sequence(rng: np.random.Generator) -> int:
    """Return the number of a frame in a tunnel's transient, at either mouth, after many others."""
    return 1000 + TUNNEL_PERIOD * int(rng.integers(2)) + int(rng.integers(TUNNEL_FRAMES))


def degrade(
    kind: str, level: float, key: DrawKey, image: Image, method: Method = "fast"
) -> tuple[str, Image]:
    """Return the true kind, and the image degraded at a level.

    Parameters
    ----------
    kind:
        A camera's kind, or kinds joined by ``+``, which are applied in that order: one of them, at
        random, has the level and is the true kind; the others have lower ones, uniform from 10 %.
    level:
        Of the strongest kind, %; at 0 the image comes back as it is, and is ``clean``.
    method:
        For the main kinds only; see ``models.degrade.camera``.
    """
    if not level:
        return "clean", image
    parts = kind.split("+")
    choice = key.generator("combination")
    strongest = int(choice.integers(len(parts)))
    lower = LEVELS[1 : max(2, int(np.searchsorted(LEVELS, level)))]
    for index, part in enumerate(parts):
        own = level if index == strongest else min(level, float(choice.choice(lower)))
        if part in MAIN_KINDS:
            image = apply(draw(part, own, key, method=method), image)
        else:
            module = module_of("camera", part)
            image = module.apply(module.draw(part, own, key), image)
    return parts[strongest], image


class Readable(Protocol):
    """A clean frame that can be read."""

    @property
    def name(self) -> str:
        """What tells it from other frames."""
        ...

    def read(self) -> Image:
        """Return the image, (height, width, 3) uint8 BGR."""
        ...


def degraded(
    frames: Sequence[Readable],
    *,
    draws: int,
    seed: int,
    method: Method = "fast",
    kinds: Sequence[str] = MAIN_KINDS,
) -> Iterator[tuple[int, str, float, Image]]:
    """Yield each clean frame ``draws`` times, degraded: frame's index, true kind, level, image.

    Kinds (see ``degrade``) in equal shares, each at a level that is uniform over the eleven; level
    0 of any kind is ``clean``.
    """
    for index, frame in enumerate(frames):
        image = frame.read()
        for draw_number in range(draws):
            key = DrawKey(seed, frame.name, draw_number)
            choice = key.generator("kind and level")
            kind, level = kinds[int(choice.integers(len(kinds)))], float(choice.choice(LEVELS))
            if kind == "tunnel":
                key = DrawKey(seed, frame.name, tunnel_sequence(choice))
            true_kind, result = degrade(kind, level, key, image, method)
            yield index, true_kind, level, result


def measure(
    estimate: Callable[[Image], Estimate],
    frames: Sequence[Readable],
    *,
    draws: int = 4,
    seed: int = 0,
    method: Method = "fast",
    kinds: Sequence[str] = MAIN_KINDS,
    afterwards: Callable[[Image], Image] = lambda image: image,
) -> Answers:
    """Return what an estimator answers to frames degraded as ``degraded`` does.

    ``afterwards`` is what happens to each frame after it was degraded, such as compression.
    """
    truth, estimates = [], []
    for index, kind, level, image in degraded(
        frames, draws=draws, seed=seed, method=method, kinds=kinds
    ):
        truth.append((CAMERA_KINDS.index(kind), level, index))
        estimates.append(estimate(afterwards(image)))
    true_kinds, levels, indices = (np.array(column) for column in zip(*truth, strict=True))
    return Answers(
        kinds=true_kinds,
        levels=levels,
        frames=indices,
        probabilities=np.array([answer.probabilities for answer in estimates]),
        kind_probabilities=np.array(
            [
                [answer.kind_probabilities.get(kind, 0.0) for kind in CAMERA_KINDS]
                for answer in estimates
            ]
        ),
    )
