"""Training samples of the camera's network: varied clean frames, degraded as the product does.

A clean frame is varied first, so that the network does not take for a degradation what other
cameras and codecs do to a good frame: cropping, shrinking, gamma, sharpening, a little sensor
noise, JPEG and H.264.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Protocol

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from models.degrade.camera import KINDS, Method, apply, draw
from models.degrade.draw import DrawKey
from models.estimate.image_features import image_features
from models.estimate.level import CAMERA_KINDS, LEVELS

Image = NDArray[np.uint8]

DEGRADED_PER_FRAME = 6
_SHARE_OF_LEVELS_BETWEEN = 0.15
_SHARE_WITHOUT_EVIDENCE = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Training samples.

    Attributes
    ----------
    features:
        (n, number of features) float32.
    levels:
        True level, %, (n,); also between the eleven.
    kinds:
        Index into ``CAMERA_KINDS``, (n,).
    """

    features: NDArray[np.float32]
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


def make_samples(frames: Sequence[Clean], passes: int, seed: int) -> Samples:
    """Return ``DEGRADED_PER_FRAME`` samples of every frame in every pass, each varied anew.

    They depend on the arguments only, not on the number of processors that share the passes.
    """
    one_pass = partial(_make_pass, frames, seed)
    if passes == 1:
        return one_pass(0)
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        parts = list(pool.map(one_pass, range(passes)))
    return Samples(
        np.concatenate([part.features for part in parts]),
        np.concatenate([part.levels for part in parts]),
        np.concatenate([part.kinds for part in parts]),
    )


def _make_pass(frames: Sequence[Clean], seed: int, turn: int) -> Samples:
    cv2.setNumThreads(1)
    features, levels, kinds = [], [], []
    for frame in frames:
        rng = DrawKey(seed, frame.name, turn).generator("variation")
        if rng.random() < _SHARE_WITHOUT_EVIDENCE:
            clean = _without_evidence(rng)
        else:
            clean = vary(frame.read(), frame.read_repaired(), rng)
        for _ in range(DEGRADED_PER_FRAME):
            kind, level = _draw_kind_and_level(rng)
            features.append(image_features(_degrade(clean, kind, level, rng)))
            levels.append(level)
            kinds.append(CAMERA_KINDS.index(kind) if level else 0)
    return Samples(np.array(features), np.array(levels, np.float32), np.array(kinds))


def _draw_kind_and_level(rng: np.random.Generator) -> tuple[str, float]:
    kind = KINDS[rng.integers(len(KINDS))]
    if rng.random() < _SHARE_OF_LEVELS_BETWEEN:
        return kind, rng.uniform(0, 100)
    return kind, float(rng.choice(LEVELS))


def _degrade(image: Image, kind: str, level: float, rng: np.random.Generator) -> Image:
    key = DrawKey(int(rng.integers(2**31)), "training", 0)
    method: Method = "exact" if kind == "blur" and rng.random() < 0.5 else "fast"
    return apply(draw(kind, level, key, method=method), image)


def _without_evidence(rng: np.random.Generator) -> Image:
    """Return a frame of one colour: black, white or any."""
    colour = rng.choice([np.zeros(3), np.full(3, 255), rng.integers(0, 256, 3)])
    shape = (int(rng.integers(1, 720)), int(rng.integers(1, 1280)), 3)
    return np.full(shape, colour, np.uint8)


def vary(image: Image, repaired: Image | None, rng: np.random.Generator) -> Image:
    """Return a clean frame as another camera, lens or codec might have delivered it."""
    image = _crop(image, repaired, rng)
    if rng.random() < 0.5:
        image = image[:, ::-1]
    image = np.ascontiguousarray(image)
    if rng.random() < 0.3:
        image = _resize(image, rng.uniform(0.5, 1.05))
    if rng.random() < 0.2:
        image = _gamma(image, rng)
    if rng.random() < 0.15:
        image = _sharpen(image, rng)
    if rng.random() < 0.25:
        image = _sensor_noise(image, rng)
    codec = rng.random()
    if codec < 0.35:
        image = _jpeg(image, int(rng.integers(50, 97)))
    elif codec < 0.65:
        image = h264(image, int(rng.integers(16, 35)))
    return image


def _crop(image: Image, repaired: Image | None, rng: np.random.Generator) -> Image:
    """Return a window: where pixels were repaired, the one of eight that holds fewest of them."""
    height, width = image.shape[:2]
    smallest = 0.06 if rng.random() < 0.04 else 0.6
    windows = []
    for _ in range(8 if repaired is not None else 1):
        scale = rng.uniform(smallest, 1)
        h, w = max(1, int(height * scale)), max(1, int(width * scale))
        top, left = rng.integers(height - h + 1), rng.integers(width - w + 1)
        windows.append(np.s_[top : top + h, left : left + w])
    if repaired is None:
        return image[windows[0]]
    return image[min(windows, key=lambda window: float(np.mean(repaired[window] > 0)))]


def _resize(image: Image, factor: float) -> Image:
    method = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    size = [max(1, round(n * factor)) for n in image.shape[1::-1]]
    return np.asarray(cv2.resize(image, size, interpolation=method), np.uint8)


def _gamma(image: Image, rng: np.random.Generator) -> Image:
    gamma, brightest = rng.uniform(0.7, 1.4), 255 * min(1.0, rng.uniform(0.8, 1.4))
    table = np.rint(brightest * np.linspace(0, 1, 256) ** gamma).astype(np.uint8)
    return np.asarray(cv2.LUT(image, table), np.uint8)


def _sharpen(image: Image, rng: np.random.Generator) -> Image:
    amount = rng.uniform(0.2, 1.2)
    soft = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.6, 1.5))
    return np.asarray(cv2.addWeighted(image, 1 + amount, soft, -amount, 0), np.uint8)


def _sensor_noise(image: Image, rng: np.random.Generator) -> Image:
    noise = rng.standard_normal(image.shape, np.float32) * np.float32(rng.uniform(0, 2.5))
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def _jpeg(image: Image, quality: int) -> Image:
    _, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR), np.uint8)


def h264(image: Image, crf: int) -> Image:
    """Return the third frame of an H.264 video in which the picture slides by two pixels a frame.

    Without x264's look-ahead, with which the result is not always the same.

    Parameters
    ----------
    crf:
        libx264's constant rate factor; 23 is its default, more is coarser.
    """
    height, width = (length // 2 * 2 for length in image.shape[:2])
    if min(height, width) < 16:
        return image
    file = io.BytesIO()
    with av.open(file, "w", format="matroska") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.options = {"crf": str(crf), "preset": "veryfast", "tune": "zerolatency"}
        for shift in (-4, -2, 0):
            moved = np.ascontiguousarray(np.roll(image, shift, axis=1)[:height, :width])
            container.mux(stream.encode(av.VideoFrame.from_ndarray(moved, format="bgr24")))
        container.mux(stream.encode())
    file.seek(0)
    with av.open(file, "r") as video:
        *_, last = video.decode(video=0)
        return np.asarray(last.to_ndarray(format="bgr24"), np.uint8)
