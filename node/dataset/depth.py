"""Depth maps that lie beside a data set: how far away each pixel of an image is."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from node.dataset.sources import Source

SUFFIXES = (".npy", ".png")

_COUNTS_A_METRE = 256.0
_EXPECTED = "a .npy of metres or a 16-bit .png of metres × 256"


def find_depth_map(folder: Path, source: Source) -> Path:
    """Return the depth map of an image: the same place below ``folder``, with another suffix.

    Raises
    ------
    InputError
        If there is none, or the source is a video.
    """
    if source.form != "image":
        raise InputError(source.path, "is no image", "--depth is of single images")
    stem = folder / PurePosixPath(source.target).with_suffix("")
    for suffix in SUFFIXES:
        path = stem.with_name(stem.name + suffix)
        if path.exists():
            return path
    raise InputError(f"{stem}.npy", "there is no such depth map", _EXPECTED)


def read_depth_map(path: Path, size: tuple[int, int]) -> NDArray[np.float32]:
    """Return a depth map, (height, width) float32, m; 0 where it says nothing.

    A 16-bit PNG file holds metres × 256, as in KITTI; 0 is no measurement.

    Raises
    ------
    InputError
        If it cannot be read or is not of this size.
    """
    try:
        depth = _read(path)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(path, f"cannot be read: {error}", f"expected {_EXPECTED}") from None
    if depth.shape != size:
        raise InputError(path, f"shape {depth.shape}", f"expected {size}, as the image")
    return depth


def _read(path: Path) -> NDArray[np.float32]:
    content: NDArray[Any] | None
    if path.suffix == ".npy":
        content = np.load(path, allow_pickle=False)
        scale = 1.0
    else:
        import cv2

        content = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        scale = _COUNTS_A_METRE
        if content is None or content.dtype != np.uint16:
            raise ValueError("not 16 bits a pixel")
    if not np.issubdtype(content.dtype, np.number) or np.iscomplexobj(content):
        raise ValueError(f"{content.dtype} is no depth")
    return np.asarray(content, np.float32) / np.float32(scale)
