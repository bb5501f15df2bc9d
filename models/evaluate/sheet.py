"""Contact sheets: every camera kind at rising levels, and a scan losing signal-to-noise ratio."""

from __future__ import annotations

from pathlib import Path

import cv2
import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from PIL import Image as PillowImage

from drivers.scan import RadarScan
from models.degrade import radar
from models.degrade.camera import Image
from models.degrade.draw import DrawKey
from models.degrade.kinds import KINDS, module_of

CAMERA_LEVELS = (0, 20, 40, 60, 80, 100)
RADAR_DROPS_DB = (0, 3, 6, 10)

_DETAIL = ("blur", "noise", "motion", "poisson", "salt_pepper", "jpeg", "dead")
"""Kinds that would vanish in a small picture: of them a detail is shown pixel by pixel."""

_CELL = (176, 99)
_MARGIN, _LABEL = 4, 92
_NOISY = ("noise", "poisson", "salt_pepper")
"""Rows that have no say in the sheet's palette: their colours are any."""


def draw_camera_sheet(image: Image, path: Path, seed: int, sequence: int = 0) -> None:
    """Write a PNG file: a row a kind, a column a level.

    Parameters
    ----------
    image:
        (height, width, 3) uint8, BGR; at least 176 × 99 pixels.
    seed, sequence:
        Of the draws.
    """
    key = DrawKey(seed, "camera", sequence)
    rows = {}
    for kind in KINDS["camera"]:
        module = module_of("camera", kind)
        cells = [
            _cell(module.apply(module.draw(kind, level, key), image), kind)
            for level in CAMERA_LEVELS
        ]
        rows[kind] = _beside([_text(kind, _LABEL, _CELL[1]), *cells])
    head = [_text("", _LABEL, 18), *(_text(f"{n} %", _CELL[0], 18) for n in CAMERA_LEVELS)]
    calm = [row for kind, row in rows.items() if kind not in _NOISY]
    path.parent.mkdir(parents=True, exist_ok=True)
    _save([_beside(head), *rows.values()], calm, path)


def draw_radar_sheet(scan: RadarScan, path: Path, seed: int) -> None:
    """Write a PNG file: the scan from above at 0, -3, -6 and -10 dB, the original in grey.

    Parameters
    ----------
    scan:
        In cluster mode.
    seed:
        Of the draws.
    """
    figure, axes = plt.subplots(1, len(RADAR_DROPS_DB), figsize=(13, 4), sharey=True)
    key = DrawKey(seed, scan.sensor, scan.sequence)
    for axis, drop_db in zip(axes, RADAR_DROPS_DB, strict=True):
        drawn = radar.draw("snr", 100 * drop_db / RADAR_DROPS_DB[-1], key)
        points = _panel(axis, scan, radar.apply(drawn, scan))
        axis.set_title(f"−{drop_db} dB" if drop_db else "as received", loc="left")
    axes[0].set_ylabel("ahead, m")
    figure.colorbar(points, ax=axes, label="radar cross-section, dBm²", fraction=0.02, pad=0.02)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100, bbox_inches="tight")
    plt.close(figure)


def _save(rows: list[Image], calm: list[Image], path: Path) -> None:
    """Write a PNG file of 256 colours: noise in true colour would not fit into a megabyte."""
    picture, model = (
        PillowImage.fromarray(np.ascontiguousarray(np.vstack(part)[:, :, ::-1]))
        for part in (rows, calm)
    )
    palette = model.quantize(256, PillowImage.Quantize.FASTOCTREE)
    picture.quantize(palette=palette, dither=PillowImage.Dither.NONE).save(path, optimize=True)


def _panel(axis: Axes, before: RadarScan, after: RadarScan) -> PathCollection:
    axis.plot(-before.y, before.x, "o", ms=6, mfc="none", mec="0.75", mew=0.8)
    points = axis.scatter(-after.y, after.x, c=after.rcs, s=11, cmap="viridis", vmin=-10, vmax=25)
    axis.plot(0, 0, "^", color="black")
    axis.set_xlabel(f"to the right, m; {len(after)} clusters")
    axis.set_xlim(-50, 50)
    axis.set_ylim(-5, max(100.0, float(before.x.max(initial=0.0)) + 5))
    axis.set_aspect("equal", adjustable="box", anchor="S")
    axis.spines[["top", "right"]].set_visible(False)
    return points


def _cell(image: Image, kind: str) -> Image:
    width, height = _CELL
    if kind not in _DETAIL:
        return np.asarray(cv2.resize(image, _CELL, interpolation=cv2.INTER_AREA), np.uint8)
    top = (image.shape[0] - height) // 2
    left = (image.shape[1] - width) // 2
    return image[top : top + height, left : left + width]


def _text(text: str, width: int, height: int) -> Image:
    canvas = np.full((height, width, 3), 255, np.uint8)
    cv2.putText(canvas, text, (2, height // 2 + 4), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1,
                cv2.LINE_AA)  # fmt: skip
    return canvas


def _beside(cells: list[Image]) -> Image:
    """Put cells of one height beside each other, with margins to the right and below."""
    white = (255, 255, 255)
    padded = [
        cv2.copyMakeBorder(cell, 0, _MARGIN, 0, _MARGIN, cv2.BORDER_CONSTANT, value=white)
        for cell in cells
    ]
    return np.asarray(np.hstack(padded), np.uint8)
