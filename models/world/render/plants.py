"""Trees and bushes: sprites that face the camera."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from models.world.objects import Kind, Objects
from models.world.render.canvas import NEAREST, Canvas
from models.world.render.textures import Gray, Image, clouds, pyramid

_SIDE = 448
_VARIANTS = 4
_LEVELS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Plants:
    """Sprites (BGRA), each as a pyramid from fine to coarse; one row of trees, one of bushes."""

    trees: tuple[tuple[Image, ...], ...]
    bushes: tuple[tuple[Image, ...], ...]


def draw_plants(rng: np.random.Generator) -> Plants:
    """Return the plants of one world."""
    trees = tuple(pyramid(_sprite(rng, 0.62, True), _LEVELS) for _ in range(_VARIANTS))
    bushes = tuple(pyramid(_sprite(rng, 1.0, False), _LEVELS) for _ in range(_VARIANTS))
    return Plants(trees, bushes)


def _sprite(rng: np.random.Generator, crown: float, trunk: bool) -> Image:
    """Return leaves in blobs that fill the upper ``crown`` share, lit from above."""
    y, x = np.mgrid[0:_SIDE, 0:_SIDE].astype(np.float32) / _SIDE
    body = _blobs(rng, crown)
    leaves = clouds(rng, _SIDE, _SIDE, 0.75)
    solid = (body + 0.30 * leaves > 0.08) & (x > 0.01) & (x < 0.99) & (y > 0.01)
    lumps = clouds(rng, _SIDE, _SIDE, 1.3)
    tone = 1.0 - 0.55 * y / crown + 0.13 * lumps + 0.17 * leaves
    green = np.array([52, 112, 100]) * rng.uniform(0.75, 1.2) + rng.uniform(-12, 12, 3)
    sprite = np.zeros((_SIDE, _SIDE, 4), np.float32)
    if trunk:
        stem = (np.abs(x - 0.5) < 0.022 + 0.01 * (y > 0.9)) & (y > 0.4)
        sprite[stem] = (58, 66, 76, 255)
        sprite[stem, :3] += (10 * leaves[stem])[:, None]
    sprite[solid, :3] = np.clip(green * tone[solid, None], 12, 235)
    sprite[solid, 3] = 255
    return np.clip(sprite, 0, 255).astype(np.uint8)


def _blobs(rng: np.random.Generator, crown: float) -> Gray:
    """Return how far inside one of many round blobs each pixel lies, 1 in a centre."""
    side = _SIDE // 4
    y, x = np.mgrid[0:side, 0:side].astype(np.float32) / side
    body = np.full((side, side), -1.0, np.float32)
    for _ in range(26):
        cx, cy = rng.normal(0.5, 0.16), crown * rng.uniform(0.25, 0.78)
        radius = rng.uniform(0.10, 0.24) * (1 - 0.6 * abs(cx - 0.5))
        body = np.maximum(body, 1 - np.hypot(x - cx, (y - cy) / max(crown, 0.7)) / radius)
    return np.asarray(cv2.resize(body, (_SIDE, _SIDE), interpolation=cv2.INTER_LINEAR), np.float32)


def paint_plant(canvas: Canvas, plants: Plants, objects: Objects, i: int) -> None:
    """Paint tree or bush ``i``."""
    view = canvas.view
    ahead, left = (float(v) for v in view.to_camera(objects.x[i], objects.y[i]))
    if ahead < NEAREST + 1.0:
        return
    tree = objects.kind[i] == Kind.TREE
    look = int(objects.look[i])
    sprites = (plants.trees if tree else plants.bushes)[look % _VARIANTS]
    scale = view.focal / ahead
    half = 0.5 * scale * max(objects.width[i], objects.height[i] * 0.7 if tree else 0.0)
    u, bottom = view.width / 2 - left * scale, view.horizon + view.above * scale
    top = bottom - objects.height[i] * scale
    x0, x1, y0, y1 = round(u - half), round(u + half), round(top), round(bottom)
    if x1 - x0 < 2 or y1 - y0 < 2 or x1 <= 0 or x0 >= view.width or y1 <= 0 or y0 >= view.height:
        return
    level = int(np.clip(np.floor(np.log2(_SIDE / (y1 - y0))), 0, _LEVELS - 1))
    left_cut, right_cut = max(x0, 0), min(x1, view.width)
    top_cut, bottom_cut = max(y0, 0), min(y1, view.height)
    source = sprites[level]
    sx, sy = source.shape[1] / (x1 - x0), source.shape[0] / (y1 - y0)
    transform = np.array(
        [[sx, 0, (left_cut - x0 + 0.5) * sx - 0.5], [0, sy, (top_cut - y0 + 0.5) * sy - 0.5]]
    )
    sprite = cv2.warpAffine(
        source,
        transform,
        (right_cut - left_cut, bottom_cut - top_cut),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
    )
    lit = float(canvas.light.on(*(np.asarray(n) for n in (0.0, 0.0, 1.0))))
    leaves = canvas.light.through_haze(np.asarray(sprite[..., :3], np.uint8), lit, ahead)
    mask = cv2.threshold(sprite[..., 3], 110, 255, cv2.THRESH_BINARY)[1]
    cv2.copyTo(leaves, mask, canvas.image[top_cut:bottom_cut, left_cut:right_cut])
