"""What a moving camera sees through its lens: successive views, to learn what stands still.

Of single frames, views as a drive would show them: what is far ahead hardly moves, what is near
moves outwards, and another frame of the same source follows; at times the vehicle stands, and its
bonnet always does. Of frames that were taken one after the other, these. And simulated drives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from models.evaluate.camera import CleanFrame
from models.evaluate.codecs import Image
from models.training.camera_vary import vary, without_evidence
from models.world.camera import WorldCamera
from models.world.road import World

MOST_LOOKS = 36

_LEAST_LOOKS = 2
_SPACINGS_S = (0.26, 0.5)
_SHARE_STANDING = 0.25
_SHARE_STOPPING = 0.2
_SHARE_WITH_BONNET = 0.5
_SHARE_WITHOUT_EVIDENCE = 0.04
_SHARE_VARIED = 0.3
_SPEEDS = (0.1, 2.5)
"""Logarithms per second by which what is half a height from the vanishing point moves outwards."""
_WORLD_S = MOST_LOOKS * _SPACINGS_S[1]
_WORLD_SIZES = ((640, 360), (960, 540), (1280, 480))


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """What a camera with a clean lens sees at successive looks.

    Attributes
    ----------
    images:
        (height, width, 3) uint8 BGR each, all of one size.
    spacing_s:
        Time from one to the next, s.
    """

    images: list[Image]
    spacing_s: float


def looks(rng: np.random.Generator) -> int:
    """Return a number of looks, small ones as often as large ones."""
    return int(np.exp(rng.uniform(np.log(_LEAST_LOOKS), np.log(MOST_LOOKS + 1))))


def driven_views(
    frame: CleanFrame, others: Sequence[CleanFrame], rng: np.random.Generator
) -> Views:
    """Return views as of a drive through a single frame, and then through others."""
    shows_nothing, is_varied = rng.random(2) < (_SHARE_WITHOUT_EVIDENCE, _SHARE_VARIED)
    first = without_evidence(rng) if shows_nothing else _read(frame, is_varied, rng)
    count, spacing_s = looks(rng), _spacing_s(rng)
    size = _view_size(first, rng)
    stands_from = _stands_from(count, rng)
    bonnet = round(size[1] * rng.uniform(0.05, 0.2)) if rng.random() < _SHARE_WITH_BONNET else 0
    speed = np.exp(rng.uniform(*np.log(_SPEEDS)))
    views: list[Image] = []
    image = first
    while len(views) < count:
        drive = _Drive(image, size, rng)
        step = spacing_s * speed * rng.uniform(0.6, 1.4)
        while len(views) < count and not drive.is_over:
            view = drive.view()
            if bonnet and views:
                view[-bonnet:] = views[0][-bonnet:]
            views.append(view)
            if len(views) < stands_from:
                drive.go(step)
        image = _read(others[int(rng.integers(len(others)))], is_varied, rng)
    return Views(views, spacing_s)


def successive_views(
    frames: Sequence[CleanFrame], spacing_s: float, rng: np.random.Generator
) -> Views:
    """Return views of frames taken one after the other, shrunk, cut and mirrored alike."""
    shrink, kept = rng.uniform(0.5, 1), rng.uniform(0.6, 1)
    top, way = rng.uniform(0, 1 - kept), 1 if rng.random() < 0.5 else -1
    views = []
    for frame in frames[: max(2, looks(rng))]:
        image = frame.read()
        first, rows = int(top * len(image)), max(1, int(kept * len(image)))
        part = image[first : first + rows, ::way]
        views.append(_resized(part, [max(1, round(n * shrink)) for n in part.shape[1::-1]]))
    return Views(views, spacing_s)


def simulated_views(seed: int, rng: np.random.Generator) -> Views:
    """Return views of a simulated drive."""
    count, spacing_s = looks(rng), _spacing_s(rng)
    width, height = _WORLD_SIZES[int(rng.integers(len(_WORLD_SIZES)))]
    camera = WorldCamera(World(seed, _WORLD_S), width=width, height=height, rate_hz=1 / spacing_s)
    return Views([camera.frame(look).image for look in range(count)], spacing_s)


class _Drive:
    """A drive through a frame: outwards from a vanishing point, the faster the farther from it."""

    def __init__(self, image: Image, size: tuple[int, int], rng: np.random.Generator) -> None:
        enlarged = rng.uniform(1, 1.25) * max(size[0] / image.shape[1], size[1] / image.shape[0])
        if enlarged < 1:  # remap takes single pixels, and noise would grow
            image = _resized(image, [max(1, round(n * enlarged)) for n in image.shape[1::-1]])
            enlarged = 1.0
        height, width = image.shape[:2]
        centre = np.array([width / 2, height / 2])
        vanishing = np.array([width * rng.uniform(0.3, 0.7), height * rng.uniform(0.35, 0.6)])
        x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
        places = (np.stack([x, y], axis=-1) - np.array(size) / 2) / enlarged + centre
        self._image = image
        self._vanishing = vanishing.astype(np.float32)
        self._away = (places - vanishing).astype(np.float32)
        distance = np.linalg.norm(self._away, axis=-1, keepdims=True) / height
        self._rates = np.minimum(1.5, 2 * distance).astype(np.float32)
        self._gone = rng.uniform(-0.5, 0.0)
        self._end = rng.uniform(0.4, 1.2)

    @property
    def is_over(self) -> bool:
        return self._gone > self._end

    def go(self, step: float) -> None:
        self._gone += step

    def view(self) -> Image:
        source = self._vanishing + self._away * np.exp(np.float32(-self._gone) * self._rates)
        shown = cv2.remap(
            self._image,
            source[..., 0],
            source[..., 1],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REFLECT_101,
        )
        return np.asarray(shown, np.uint8)


def _read(frame: CleanFrame, is_varied: bool, rng: np.random.Generator) -> Image:
    return vary(frame.read(), frame.read_repaired(), rng) if is_varied else frame.read()


def _spacing_s(rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(*np.log(_SPACINGS_S))))


def _view_size(image: Image, rng: np.random.Generator) -> tuple[int, int]:
    """Return width and height of the views: of usual proportions, or wide, or nearly square."""
    height, width = image.shape[:2]
    shrink = rng.uniform(0.45, 0.8) if width > 900 else rng.uniform(0.7, 1)
    width, height = max(32, int(width * shrink)), max(32, int(height * shrink))
    form = rng.random()
    if form < 0.25:
        height = max(32, int(width / rng.uniform(1.9, 3.4)))
    elif form < 0.45:
        width = int(height * rng.uniform(1, 1.5))
    return width, height


def _stands_from(count: int, rng: np.random.Generator) -> int:
    """Return the look from which the vehicle stands."""
    chance = rng.random()
    if chance < _SHARE_STANDING:
        return 0
    return int(rng.integers(count)) if chance < _SHARE_STANDING + _SHARE_STOPPING else count + 1


def _resized(image: Image, size: Sequence[int]) -> Image:
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
