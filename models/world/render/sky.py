"""Sky, clouds and the far skyline, as one panorama that turns with the ego."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from models.world.render.light import Light
from models.world.render.textures import Gray, Image, clouds
from models.world.render.view import View

_WIDTH, _HEIGHT = 4096, 512
_SKYLINE = 72
_CLOUD = (246.0, 244.0, 242.0)


@dataclass(frozen=True, slots=True, eq=False)
class Panorama:
    """The far world all around, (``_HEIGHT``, ``_WIDTH``, 3); the last row is the horizon."""

    image: Image


def panorama(rng: np.random.Generator, light: Light) -> Panorama:
    """Return sky with clouds, and a strip of hills, woods and roofs on the horizon."""
    rows = np.linspace(0, 1, _HEIGHT, dtype=np.float32)[:, None, None] ** 1.5
    zenith, horizon, bright = np.array([light.zenith, light.horizon, _CLOUD], np.float32)
    image = np.broadcast_to(zenith + (horizon - zenith) * rows, (_HEIGHT, _WIDTH, 3))
    field = clouds(rng, _HEIGHT, _WIDTH, 1.35)[..., None]
    cover = np.clip((field + np.float32(rng.uniform(-0.9, 0.6))) * 0.7, 0, 1)
    cover *= 0.35 + 0.65 * rows
    image = image + (bright - 22 * np.clip(field - 1, 0, 2) - image) * cover
    _skyline(rng, image[-_SKYLINE:], light)
    return Panorama(np.clip(image, 0, 255).astype(np.uint8))


def _skyline(rng: np.random.Generator, image: Gray, light: Light) -> None:
    """Paint hills, then roofs and woods, into the bottom of the panorama."""
    height = image.shape[0]
    row = np.arange(height)[:, None]
    hills = height - 14 - 9 * clouds(rng, 1, _WIDTH, 2.0)[0]
    woods = height - 12 - 6 * np.abs(clouds(rng, 1, _WIDTH, 0.75)[0])
    roofs = np.full(_WIDTH, float(height))
    for start in rng.integers(0, _WIDTH - 40, 130):
        end = start + int(rng.integers(8, 40))
        roofs[start:end] = np.minimum(roofs[start:end], height * rng.uniform(0.45, 0.9))
    grain = clouds(rng, height, _WIDTH, 0.4)[..., None]
    for line, colour, contrast in (
        (hills, (150, 138, 118), 3.0),
        (roofs, (138, 136, 138), 9.0),
        (woods, (70, 96, 84), 14.0),
    ):
        below = (row > line)[..., None]
        haze = 0.45 if contrast < 5 else 0.2
        tone = np.asarray(colour) * (1 - haze) + np.asarray(light.horizon) * haze
        np.copyto(image, tone + contrast * grain, where=below, casting="same_kind")


def paint_sky(image: Image, view: View, far: Panorama) -> None:
    """Paint everything above the horizon into ``image``."""
    bottom = int(np.clip(np.ceil(view.horizon) + 4, 1, view.height))
    per_pixel = _WIDTH / (2 * np.pi * view.focal)
    scale = 1 / per_pixel
    column = np.arange(view.width, dtype=np.float32)
    angle = np.arctan((view.width / 2 - column) / view.focal) + view.heading
    x = np.mod(-angle / (2 * np.pi), 1) * _WIDTH
    row = np.arange(bottom, dtype=np.float32)
    y = np.clip((row - view.horizon - 3) / scale + _HEIGHT, 0, _HEIGHT - 1)
    grid = np.broadcast_to(x.astype(np.float32), (bottom, view.width))
    lines = np.broadcast_to(y[:, None].astype(np.float32), (bottom, view.width))
    cv2.remap(
        far.image,
        np.ascontiguousarray(grid),
        np.ascontiguousarray(lines),
        cv2.INTER_LINEAR,
        dst=image[:bottom],
        borderMode=cv2.BORDER_WRAP,
    )
