"""Walls with texture: houses, walls, the inside of tunnels, in perspective."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from models.world.objects import Floats, Kind, Objects
from models.world.render.canvas import NEAREST, Canvas, fill
from models.world.render.textures import Image, clouds, pyramid, white

_METRES = 12.8
_PIXELS = 512
_LEVELS = 6

_WALLS = ((92, 104, 138), (150, 160, 168), (120, 132, 142), (84, 92, 120), (168, 172, 172),
          (136, 150, 164), (108, 112, 114))  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Facades:
    """Tiles of ``_METRES`` square, each as a pyramid from fine to coarse; the last is concrete."""

    tiles: tuple[tuple[Image, ...], ...]


def draw_facades(rng: np.random.Generator) -> Facades:
    """Return the facades of one world."""
    tiles = [_windows(rng, colour) for colour in _WALLS]
    tiles.append(_rough(rng, (134, 136, 138), 6.0))
    return Facades(tuple(pyramid(tile, _LEVELS) for tile in tiles))


def _rough(rng: np.random.Generator, colour: tuple[int, ...], contrast: float) -> Image:
    """Return a rough wall."""
    grain = 0.6 * white(rng, _PIXELS, _PIXELS) + clouds(rng, _PIXELS, _PIXELS, 1.0)
    wall: Image = np.clip(np.asarray(colour) + contrast * grain[..., None], 0, 255).astype(np.uint8)
    return wall


def _windows(rng: np.random.Generator, colour: tuple[int, ...]) -> Image:
    """Return a wall of bricks or plaster with four floors of windows."""
    tile = _rough(rng, colour, 7.0)
    if rng.random() < 0.5:
        for row in range(0, _PIXELS, 4):
            tile[row] = (tile[row] * 0.86).astype(np.uint8)
        shift = rng.integers(-9, 10, (_PIXELS // 4, _PIXELS // 10 + 1))
        bricks = np.repeat(np.repeat(shift, 4, 0), 10, 1)[:_PIXELS, :_PIXELS, None]
        tile = np.clip(tile + bricks, 0, 255).astype(np.uint8)
    bays = int(rng.choice([3, 4, 5]))
    wide, tall = rng.uniform(0.35, 0.65), rng.uniform(0.42, 0.66)
    floor, bay = _PIXELS // 4, _PIXELS / bays
    for storey in range(4):
        for column in range(bays):
            left = int((column + 0.5 - wide / 2) * bay)
            right = int((column + 0.5 + wide / 2) * bay)
            top = storey * floor + int(floor * (1 - tall) * 0.5)
            _window(rng, tile, left, top, right, top + int(floor * tall))
        tile[storey * floor : storey * floor + 3] = (tile[storey * floor] * 0.8).astype(np.uint8)
    return tile


def _window(
    rng: np.random.Generator, tile: Image, left: int, top: int, right: int, bottom: int
) -> None:
    """Paint one window: frame, glass that mirrors the sky, curtains now and then."""
    frame = int(rng.choice([70, 190, 205]))
    cv2.rectangle(tile, (left - 3, top - 3), (right + 3, bottom + 3), (frame,) * 3, -1)
    height = np.linspace(1, 0.4, bottom - top)[:, None, None]
    glass = np.array([104.0, 88.0, 74.0]) * height * rng.uniform(0.6, 1.3)
    glass = glass + rng.normal(0, 3, (bottom - top, right - left, 1))
    if rng.random() < 0.4:
        drop = int((bottom - top) * rng.uniform(0.2, 0.9))
        glass[:drop] = rng.uniform(130, 185) + rng.normal(0, 5, (1, right - left, 1))
    tile[top:bottom, left:right] = np.clip(glass, 0, 255).astype(np.uint8)
    middle = (left + right) // 2
    cv2.line(tile, (middle, top), (middle, bottom), (frame,) * 3, 2)
    cv2.rectangle(tile, (left - 5, bottom + 3), (right + 5, bottom + 6), (176, 178, 178), -1)
    cv2.line(tile, (left - 4, bottom + 8), (right + 4, bottom + 8), (60, 62, 66), 1)


def paint_facades(canvas: Canvas, facades: Facades, objects: Objects, i: int, dim: float) -> None:
    """Paint those faces of building or wall ``i`` that can be seen."""
    view = canvas.view
    corners = objects[np.array([i])].corners()[0]
    ahead, left = view.to_camera(corners[:, 0], corners[:, 1])
    wall = objects.kind[i] == Kind.WALL
    look = int(objects.look[i])
    number = len(facades.tiles) - 1 if wall else look % (len(facades.tiles) - 1)
    for one, other in ((0, 1), (1, 2), (2, 3), (3, 0)):
        a = np.array([ahead[one], left[one]])
        b = np.array([ahead[other], left[other]])
        along = b - a
        normal = np.array([along[1], -along[0]])
        if normal @ a >= 0 or max(a[0], b[0]) < NEAREST:
            continue
        normal = normal / np.hypot(*normal)
        cos, sin = np.cos(view.heading), np.sin(view.heading)
        lit = float(
            canvas.light.on(
                np.asarray(normal[0] * cos - normal[1] * sin),
                np.asarray(normal[0] * sin + normal[1] * cos),
                np.asarray(0.0),
            )
        )
        _face(
            canvas,
            facades.tiles[number],
            a,
            b,
            float(objects.height[i]),
            lit * dim,
            float(look % 97) / 97,
        )


def _face(
    canvas: Canvas,
    tiles: tuple[Image, ...],
    a: Floats,
    b: Floats,
    tall: float,
    lit: float,
    shift: float,
) -> None:
    """Paint one upright face from ``a`` to ``b`` (ahead, left; m)."""
    view = canvas.view
    length = float(np.hypot(*(b - a)))
    cut = (
        np.clip([(NEAREST - a[0]) / (b[0] - a[0] + 1e-9), 1.0], 0, 1)[0] if a[0] < NEAREST else 0.0
    )
    end = (NEAREST - a[0]) / (b[0] - a[0]) if b[0] < NEAREST else 1.0
    span = np.array([cut, end, end, cut])
    ahead, left = a[0] + span * (b[0] - a[0]), a[1] + span * (b[1] - a[1])
    up = np.array([0.0, 0.0, tall, tall])
    u, v = view.pixels(np.stack([ahead, left, up], axis=1)).T
    x0, x1 = int(max(np.floor(u.min()), 0)), int(min(np.ceil(u.max()) + 1, view.width))
    y0, y1 = int(max(np.floor(v.min()), 0)), int(min(np.ceil(v.max()) + 1, view.height))
    if x1 - x0 < 1 or y1 - y0 < 1:
        return
    per_metre = max((u.max() - u.min()) / max(length * (end - cut), 0.1), 1e-3)
    upright = (v.max() - v.min()) / tall
    fine = _PIXELS / _METRES / np.sqrt(per_metre * upright)
    level = int(np.clip(np.rint(np.log2(max(fine, 1e-3))), 0, _LEVELS - 1))
    tile = tiles[level]
    scale = tile.shape[0] / _METRES
    source = np.stack([(span * length + shift * _METRES) * scale, (tall - up) * scale], axis=1)
    target = np.stack([u - x0, v - y0], axis=1)
    transform = cv2.getPerspectiveTransform(target.astype(np.float32), source.astype(np.float32))
    patch = cv2.warpPerspective(
        tile,
        transform,
        (x1 - x0, y1 - y0),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_WRAP,
    )
    hazed = canvas.light.through_haze(np.asarray(patch, np.uint8), lit, float(ahead.mean()))
    mask = np.zeros(hazed.shape[:2], np.uint8)
    fill(mask, target, (255,))
    cv2.copyTo(hazed, mask, canvas.image[y0:y1, x0:x1])
