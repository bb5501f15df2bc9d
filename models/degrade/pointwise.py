"""Fast randomness for images: fresh random bytes, mapped to any distribution by tables."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from statistics import NormalDist

import cv2
import numpy as np
import stringzilla
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]

_STRIPS = 16
_MAX_STRIP = 2**18
_BANK = 2**22
_LEAST_ROWS = 50


def strips(seed: int, size: int, tables: int) -> Iterator[tuple[slice, Bytes, int]]:
    """Yield the parts of ``size`` samples, random bytes for each, and the table that it takes.

    A strip's bytes are the sum modulo 256 of two banks of random bytes, each from a place of its
    own: independent of either bank, so that nothing repeats unless both places do.

    Yields
    ------
    The strip's place, its (1, n) random bytes, and a number below ``tables``; the tables come in
    shuffled order, each as often as the others.
    """
    length = min(-(-size // _STRIPS), _MAX_STRIP)
    starts = range(0, size, length)
    generator = np.random.SFC64(seed)
    places = generator.random_raw((len(starts), 2)) % np.uint64(_BANK - length)
    order = np.argsort(generator.random_raw(tables), kind="stable").tolist()
    first, second = _banks()
    for strip, (start, (one, other)) in enumerate(zip(starts, places.tolist(), strict=True)):
        n = min(length, size - start)
        random = first[None, one : one + n] + second[None, other : other + n]
        yield slice(start, start + n), random, order[strip % tables]


def words(seed: int, size: int) -> Iterator[tuple[slice, NDArray[np.uint16]]]:
    """Yield the parts of ``size`` samples and (1, n) random 16-bit words for each.

    As in ``strips`` a word is the sum of two, each from a place of its own in a bank.
    """
    first, second = (bank.view("<u2") for bank in _banks())
    starts = range(0, size, _MAX_STRIP // 2)
    places = np.random.SFC64(seed).random_raw((len(starts), 2))
    places %= np.uint64(first.size - _MAX_STRIP // 2)
    for start, (one, other) in zip(starts, places.tolist(), strict=True):
        n = min(_MAX_STRIP // 2, size - start)
        yield slice(start, start + n), first[None, one : one + n] + second[None, other : other + n]


def uniform(seed: int, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return uniform numbers in [0, 1), the same on every machine."""
    raw = np.random.SFC64(seed).random_raw(math.prod(shape))
    return np.asarray((raw >> 11).reshape(shape) * 2.0**-53, np.float64)


@cache
def _banks() -> tuple[Bytes, Bytes]:
    """Return two banks of ``_BANK`` random bytes, the same in every run."""
    first, second = (np.random.SFC64(seed).random_raw(_BANK // 8) for seed in (1, 2))
    return first.view(np.uint8), second.view(np.uint8)


@cache
def normal_quantiles(tables: int) -> NDArray[np.float64]:
    """Return (tables, 256) standard normal quantiles by random byte.

    One byte gives 256 quantiles only. Each table is shifted by a fraction of a quantile, so that
    an image whose strips take different tables has ``tables`` × 256 of them. Each is symmetric
    about 0.
    """
    normal = NormalDist()
    half = [
        [normal.inv_cdf((k + (row + 0.5) / tables) / 256) for k in range(128)]
        for row in range(tables)
    ]
    return np.hstack([half, -np.array(half)])


def add_noise(
    image: Bytes, std_by_value: NDArray[np.float64], mean: NDArray[np.float64], seed: int
) -> Bytes:
    """Return ``mean[value] + N(0, std_by_value[value])`` for each sample, rounded and clipped.

    Parameters
    ----------
    image:
        Any shape, uint8.
    std_by_value, mean:
        (256,), counts: standard deviation and new value for each old value.
    seed:
        Of the random bytes.
    """
    quantiles = normal_quantiles(4).astype(np.float32)
    spread = std_by_value.astype(np.float32)[:, None]
    tables = []
    for row in quantiles:
        values = mean[:, None] + spread * row
        np.rint(values, out=values)
        tables.append(np.clip(values, 0, 255).astype(np.uint8).reshape(1, -1))
    flat = np.ascontiguousarray(image).reshape(1, -1)
    noisy = np.empty_like(flat)
    for part, random, table in strips(seed, flat.size, len(tables)):
        pairs = cv2.merge([random, flat[:, part]]).view("<u2").reshape(1, -1)
        noisy[:, part] = cv2.LUT(pairs, tables[table])
    return noisy.reshape(image.shape)


def looked_up(values: Bytes, table: Bytes) -> Bytes:
    """Return ``table[value]`` for each value; stringzilla's vector code, ten times OpenCV's speed.

    Parameters
    ----------
    values:
        Any shape, uint8.
    table:
        (256,) uint8.
    """
    values = np.ascontiguousarray(values)
    result = np.empty_like(values)
    stringzilla.translate(values.data, table.data, out=result)
    return result


def bands(shape: tuple[int, ...], most_bytes: int = _MAX_STRIP) -> Iterator[slice]:
    """Yield the rows of an image in bands that stay in the cache.

    What is put together whole needs memory beside the image's, which the system gives and takes
    back at every call; that takes longer than the arithmetic.
    """
    rows = max(_LEAST_ROWS, most_bytes // (3 * shape[1]))
    for top in range(0, shape[0], rows):
        yield slice(top, top + rows)


def veil(image: Bytes, transmission: Bytes, airlight: float, falling: Bytes | None = None) -> Bytes:
    """Return ``value t + airlight (1 - t)``, both parts rounded, with t = transmission / 255.

    Parameters
    ----------
    image:
        (height, width, 3) uint8.
    transmission:
        (height, width) uint8.
    airlight:
        Counts.
    falling:
        (height, width) uint8, light added to that, in front of it.
    """
    glow = np.clip(np.rint(airlight * (1 - np.arange(256) / 255)), 0, 255).astype(np.uint8)
    result = np.empty(image.shape, np.uint8)
    for part in bands(image.shape):
        here, share = result[part], transmission[part]
        cv2.multiply(image[part], _in_colour(share), scale=1 / 255, dst=here)
        cv2.add(here, _in_colour(looked_up(share, glow)), dst=here)
        if falling is not None:
            cv2.add(here, _in_colour(falling[part]), dst=here)
    return result


def _in_colour(gray: Bytes) -> Bytes:
    return np.asarray(cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR), np.uint8)
