"""JPEG's loss without a codec: block transform, quantisation and back, by matrix products.

What a codec spends on entropy coding is saved here; it is measured beside the codec because it
might have been faster.
"""

from __future__ import annotations

from io import BytesIO

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage

Image = NDArray[np.uint8]
Floats = NDArray[np.float32]

_N = 8


def quantisation_tables(stream: Image) -> tuple[Floats, Floats]:
    """Return the luma and chroma tables of a JPEG stream, (64,) each."""
    with PillowImage.open(BytesIO(stream.tobytes())) as picture:
        tables = picture.quantization  # type: ignore[attr-defined]
    return np.array(tables[0], np.float32), np.array(tables[1], np.float32)


def without_codec(image: Image, luma: Floats, chroma: Floats) -> Image:
    """Return what encoding and decoding with these tables gives, chroma halved both ways.

    Parameters
    ----------
    image:
        (height, width, 3) uint8, height and width even.
    """
    height, width, _ = image.shape
    y, *colours = cv2.split(cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb))
    half = (width // 2, height // 2)
    planes = [_quantised(np.asarray(y, np.uint8), luma)]
    for plane in colours:
        small = cv2.resize(plane, half, interpolation=cv2.INTER_AREA)
        lossy = _quantised(np.asarray(small, np.uint8), chroma)
        planes.append(
            np.asarray(cv2.resize(lossy, (width, height), interpolation=cv2.INTER_LINEAR), np.uint8)
        )
    return np.asarray(cv2.cvtColor(cv2.merge(planes), cv2.COLOR_YCrCb2BGR), np.uint8)


def _quantised(plane: Image, table: Floats) -> Image:
    height, width = plane.shape
    down, across = -(-height // _N), -(-width // _N)
    padded = cv2.copyMakeBorder(plane, 0, down * _N - height, 0, across * _N - width,
                                cv2.BORDER_REPLICATE)  # fmt: skip
    blocks = padded.reshape(down, _N, across, _N).swapaxes(1, 2).reshape(-1, _N * _N)
    transform = _transform()
    coefficients = (blocks.astype(np.float32) - 128) @ transform
    coefficients /= table
    np.rint(coefficients, out=coefficients)
    coefficients *= table
    back = coefficients @ transform.T + 128
    np.rint(back, out=back)
    np.clip(back, 0, 255, out=back)
    rows = back.reshape(down, across, _N, _N).swapaxes(1, 2).reshape(down * _N, across * _N)
    return rows[:height, :width].astype(np.uint8)


def _transform() -> Floats:
    """Return (64, 64): the discrete cosine transform of a flattened block."""
    k, n = np.mgrid[:_N, :_N]
    rows = np.sqrt(np.where(k == 0, 1, 2) / _N) * np.cos(np.pi * (2 * n + 1) * k / (2 * _N))
    return np.kron(rows, rows).T.astype(np.float32)
