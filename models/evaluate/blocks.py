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
_YCBCR = np.array(
    [
        [0.299, 0.587, 0.114],
        [-0.299 / 1.772, -0.587 / 1.772, 0.5],
        [0.5, -0.587 / 1.402, -0.114 / 1.402],
    ]
)
"""Luma and chroma of red, green and blue (JFIF)."""


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


def in_float64(image: Image, luma: Floats, chroma: Floats) -> NDArray[np.float64]:
    """Return what JPEG with these tables is in float64, but for the quantisation nothing rounded.

    Colours by JFIF; chroma is the mean of 2 × 2 pixels, and comes back by bilinear interpolation;
    what lies beyond the image repeats its edge.
    """
    height, width, _ = image.shape
    pad = ((0, -height % 16), (0, -width % 16), (0, 0))
    planes = np.pad(image, pad, mode="edge")[..., ::-1].astype(np.float64) @ _YCBCR.T
    half = (-(-width // 2), -(-height // 2))
    lossy = [_quantised64(planes[..., 0] - 128, luma)[:height, :width]]
    for plane in (planes[..., 1], planes[..., 2]):
        small = plane.reshape(len(plane) // 2, 2, -1, 2).mean(axis=(1, 3))
        coarse = _quantised64(small, chroma)[: half[1], : half[0]]
        fine = cv2.resize(coarse, (2 * half[0], 2 * half[1]), interpolation=cv2.INTER_LINEAR)
        lossy.append(np.asarray(fine, np.float64)[:height, :width])
    lossy[0] += 128
    return np.asarray((np.stack(lossy, axis=2) @ np.linalg.inv(_YCBCR).T)[..., ::-1])


def _quantised64(plane: NDArray[np.float64], table: Floats) -> NDArray[np.float64]:
    down, across = plane.shape[0] // _N, plane.shape[1] // _N
    blocks = plane.reshape(down, _N, across, _N).swapaxes(1, 2).reshape(-1, _N * _N)
    transform = _transform()
    steps = blocks @ transform / table
    back = np.copysign(np.floor(np.abs(steps) + 0.5), steps) * table @ transform.T
    return np.asarray(back.reshape(down, across, _N, _N).swapaxes(1, 2).reshape(plane.shape))


def _quantised(plane: Image, table: Floats) -> Image:
    height, width = plane.shape
    down, across = -(-height // _N), -(-width // _N)
    padded = cv2.copyMakeBorder(plane, 0, down * _N - height, 0, across * _N - width,
                                cv2.BORDER_REPLICATE)  # fmt: skip
    blocks = padded.reshape(down, _N, across, _N).swapaxes(1, 2).reshape(-1, _N * _N)
    transform = _transform().astype(np.float32)
    coefficients = (blocks.astype(np.float32) - 128) @ transform
    coefficients /= table
    np.rint(coefficients, out=coefficients)
    coefficients *= table
    back = coefficients @ transform.T + 128
    np.rint(back, out=back)
    np.clip(back, 0, 255, out=back)
    rows = back.reshape(down, across, _N, _N).swapaxes(1, 2).reshape(down * _N, across * _N)
    return rows[:height, :width].astype(np.uint8)


def _transform() -> NDArray[np.float64]:
    """Return (64, 64): the discrete cosine transform of a flattened block."""
    k, n = np.mgrid[:_N, :_N]
    rows = np.sqrt(np.where(k == 0, 1, 2) / _N) * np.cos(np.pi * (2 * n + 1) * k / (2 * _N))
    return np.asarray(np.kron(rows, rows).T)
