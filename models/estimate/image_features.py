"""What a camera frame shows of its own degradation, as one vector for the camera's network.

Everything is read at native resolution (shrinking destroys the evidence of noise and blur), from
bands of a few full rows spread over the height, so that the cost does not grow with the frame.

- Histograms of the three channels: clipping, the plateau under a ceiling, brightness.
- The comb: where the frame was locally constant, a gain g leaves only the values round(g·k), so
  the histogram of locally constant pixels has gaps that betray g.
- Histograms of differences at several distances: noise against structure.
- The power spectrum along rows and along columns: a Gaussian blur multiplies it by
  exp(−σ²ω²), noise and rounding lay a floor under it.
- A coarse map of brightness, of detail, of the darkest and the brightest, and of colour: fog takes
  contrast and colour off what is far, dirt off a part.
- Thin bright things against thin dark ones, along rows and down columns: rain and snow fall before
  the scene, are brighter than it and never darker; dead pixels stand alone.
- Differences along both diagonals: a motion smears one of them more.
"""

from __future__ import annotations

from math import prod

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dbc.errors import InputError
from models.estimate.exposure import MEASURES
from models.estimate.image_places import FLOOR, LOG_DETAIL, PLACES, brightness_of, means, places
from models.estimate.level import LEVELS

_ROWS = 8
_PIXELS = 80_000
_LINE_PIXELS = 16_000
_SEGMENT = 64
_BUSY_SHARES = (0.25, 0.1, 0.03)
_SQUARE = np.ones((3, 3), np.uint8)
_DIFFERENCE_EDGES = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)
_THIN_COUNTS = (1, 3, 6, 12, 24, 48, 96, 180)
_STREAK_ROWS = 4
_EVERY_PLACE = 4
_LEAST_SHARE = 1e-5
_DIAGONAL_STEPS = (2, 4)
_PLACE_RANKS = np.array([7, 21, 36, 50, 64])
_AT_HISTOGRAMS = prod(PLACES) + prod(PLACES[1:])
_HISTOGRAM = 64 + 8 + 8
_ENDS = np.array([64, 65, 78, 79])


def _fourier() -> NDArray[np.float32]:
    """Return the matrix that takes a segment to its spectrum, real and imaginary parts in turn.

    The segment's mean is taken off and a Hann window of unit energy laid over it.
    """
    window = np.hanning(_SEGMENT + 1)[:_SEGMENT]
    centre = np.eye(_SEGMENT) - 1 / _SEGMENT
    spectrum = np.fft.rfft(centre * window / np.linalg.norm(window), axis=1)[:, 1:]
    return spectrum.view(np.float64).astype(np.float32)


_FOURIER = _fourier()


def _combs() -> NDArray[np.float32]:
    """Return the values that each exposure gain leaves possible, 0 or 1, shape (21, 256).

    Full-range video first (gains 1.3 to 4), then video of limited range (16–235), as H.264 mostly
    is, whose conversion is a comb of its own (gains 1 to 4).
    """
    full = np.arange(256.0)
    limited = np.rint((np.arange(16, 236) - 16) * 255 / 219)
    gains = 1 + 3 * LEVELS / 100
    combs = np.zeros((2 * len(gains) - 1, 256), np.float32)
    cases = [(gain, full) for gain in gains[1:]] + [(gain, limited) for gain in gains]
    for comb, (gain, values) in zip(combs, cases, strict=True):
        comb[np.minimum(np.rint(gain * values), 255).astype(int)] = 1
    return combs


_COMBS = _combs()


def image_features(image: NDArray[np.uint8], effort: float = 1.0) -> NDArray[np.float32]:
    """Return the features of one frame.

    Parameters
    ----------
    image:
        (height, width, 3) uint8 BGR of any size from 1×1 up.
    effort:
        Pixels to read, as a multiple of the usual 80,000 in bands and 16,000 on lines.

    Returns
    -------
    (n,) float32, finite; n does not depend on the size. The first are what is in each place, of
    shape ``image_places.PLACES``.

    Raises
    ------
    InputError
        If the array is no such image.
    """
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
        raise InputError(
            "image", f"{image.dtype} of shape {image.shape}", "expected uint8 (height, width, 3)"
        )
    image = _at_least_one_segment(image)
    planes = _bands(image, effort)
    in_places = places(planes)
    parts = [
        np.ravel(in_places),
        np.sort(in_places[LOG_DETAIL]),
        _histograms(planes),
        _comb(planes),
        _differences(planes[1]),
        _spectra(image[..., 1], effort),
        _thin(planes[1]),
        _diagonals(planes[1]),
    ]
    return np.concatenate(parts, dtype=np.float32)


def exposure(features: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return how a frame is exposed, from its features: what is kept of it for those that follow.

    Returns
    -------
    (7,) float64: log2 of the brightness, counts, of five places in rank, dimmest first, and the
    roots of the shares of pixels that are black (0 or 1) and clipped (254 or 255).
    """
    brightness = features[: prod(PLACES[1:])]
    return _exposure(brightness, features[_AT_HISTOGRAMS:][: 3 * _HISTOGRAM])


def exposures(image: NDArray[np.uint8], tables: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return how a frame would be exposed after each of some tables (n, 256) of values: (n, 7)."""
    planes = _bands(_at_least_one_segment(image), 1.0)
    found = []
    for table in tables:
        changed = np.asarray(cv2.LUT(planes, table), np.uint8)
        found.append(_exposure(brightness_of(changed), _histograms(changed)))
    return np.array(found)


def _exposure(
    brightness: NDArray[np.float32], histograms: NDArray[np.float32]
) -> NDArray[np.float64]:
    measures = np.empty(MEASURES)
    measures[:5] = np.log2(np.sort(brightness)[_PLACE_RANKS] * 255.0 + 0.5)
    roots = histograms.reshape(3, _HISTOGRAM)[:, _ENDS]
    measures[5:] = np.sqrt((roots * roots).reshape(3, 2, 2).sum(axis=(0, 2)) / 3)
    return measures


def _at_least_one_segment(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    height, width = image.shape[:2]
    below, right = max(0, _SEGMENT - height), max(0, _SEGMENT - width)
    if not below and not right:
        return image
    return np.asarray(
        cv2.copyMakeBorder(image, 0, below, 0, right, cv2.BORDER_REFLECT_101), np.uint8
    )


def _bands(image: NDArray[np.uint8], effort: float) -> NDArray[np.uint8]:
    """Return the bands one below the other, each channel for itself: (3, rows, width)."""
    height, width = image.shape[:2]
    count = min(height // _ROWS, max(1, round(effort * _PIXELS / (_ROWS * width))))
    tops = ((np.arange(count) + 0.5) * height / count - _ROWS / 2).astype(int)
    planes = np.empty((3, count * _ROWS, width), np.uint8)
    for band, top in enumerate(tops):
        here = planes[:, band * _ROWS : (band + 1) * _ROWS]
        cv2.mixChannels([image[top : top + _ROWS]], list(here), [0, 0, 1, 1, 2, 2])
    return planes


def _count(plane: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return how often each value occurs, shape (256,)."""
    return np.ravel(cv2.calcHist([plane], [0], None, [256], [0, 256])).astype(np.float32)


def _histograms(planes: NDArray[np.uint8]) -> NDArray[np.float32]:
    parts = []
    for plane in planes:
        half = plane[::2]
        share = _count(half) / half.size
        parts += [share.reshape(64, 4).sum(axis=1), share[:8], share[-8:]]
    return np.asarray(np.sqrt(np.concatenate(parts)), np.float32)


def _comb(planes: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the histogram of locally constant pixels, and the share that fits each comb."""
    counts = np.zeros(256, np.float32)
    for plane in planes:
        varying = cv2.morphologyEx(plane, cv2.MORPH_GRADIENT, _SQUARE)
        _, constant = cv2.threshold(varying, 0, 255, cv2.THRESH_BINARY_INV)
        marked = cv2.bitwise_and(plane, constant)
        counts += _count(np.asarray(marked, np.uint8))
        counts[0] -= marked.size - cv2.countNonZero(constant)
    share = counts / planes.size
    dark, clipped = share[0], share[254:].sum()
    share[[0, 254, 255]] = 0
    total = share.sum()
    shape = share / (total + 1e-4)
    return np.concatenate(
        [[np.log10(total + 1e-6), dark, clipped], np.sqrt(shape), _COMBS @ shape],
        dtype=np.float32,
    )


def _differences(green: NDArray[np.uint8]) -> NDArray[np.float32]:
    pairs = [(green[::2, step:], green[::2, :-step]) for step in (1, 2, 4, 8)]
    pairs.append((green[1::2], green[::2]))
    middle = cv2.addWeighted(green[::2, 2:], 0.5, green[::2, :-2], 0.5, 0)
    pairs.append((green[::2, 1:-1], np.asarray(middle, np.uint8)))
    parts = []
    for one, other in pairs:
        difference = np.asarray(cv2.absdiff(one, other), np.uint8)
        parts.append(np.add.reduceat(_count(difference), _DIFFERENCE_EDGES) / difference.size)
    return np.asarray(np.sqrt(np.concatenate(parts)), np.float32)


def _thin(green: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return how much is brighter, and how much darker, than its row around it.

    Log shares of pixels, against 5 pixels around them, against 17, and against 5 in each of four
    rows one below the other, as a streak is. Of the last two also how bright against dark goes by
    place, in rising order: rain and snow fall everywhere.
    """
    shares, by_place = [], []
    for way in (cv2.MORPH_TOPHAT, cv2.MORPH_BLACKHAT):
        narrow = cv2.morphologyEx(green, way, np.ones((1, 5), np.uint8))
        wide = cv2.morphologyEx(green[::2], way, np.ones((1, 17), np.uint8))
        slanted = cv2.dilate(narrow, np.ones((1, 3), np.uint8))
        streaks = np.asarray(slanted).reshape(-1, _STREAK_ROWS, slanted.shape[1]).min(axis=1)
        shares += [_log_shares(plane) for plane in (narrow[::2], wide, streaks)]
        by_place.append([np.log(means(plane) + FLOOR) for plane in (wide, streaks)])
    bright, dark = np.array(by_place)
    rising = np.sort(np.concatenate([bright, bright - dark]), axis=1)[:, ::_EVERY_PLACE]
    return np.concatenate([*shares, np.ravel(rising)])


def _log_shares(plane: MatLike) -> NDArray[np.float32]:
    """Return log10 of the shares of values above each of ``_THIN_COUNTS``.

    Not by a histogram, which is slow where nearly all values are the same.
    """
    above = [
        cv2.countNonZero(cv2.threshold(plane, count, 1, cv2.THRESH_BINARY)[1])
        for count in _THIN_COUNTS
    ]
    return np.log10(np.array(above) / plane.size + _LEAST_SHARE).astype(np.float32)


def _diagonals(green: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return log mean differences along one diagonal and along the other."""
    differences = []
    for step in _DIAGONAL_STEPS:
        upper, lower = green[:-step], green[step:]
        falling, rising = (upper[:, :-step], lower[:, step:]), (upper[:, step:], lower[:, :-step])
        for one, other in (falling, rising):
            differences.append(cv2.norm(one, other, cv2.NORM_L1) / one.size)
    return np.asarray(np.log(np.array(differences, np.float32) + FLOOR), np.float32)


def _spectra(green: NDArray[np.uint8], effort: float) -> NDArray[np.float32]:
    """Return the spectra along some rows and along some columns, spread over the frame."""
    height, width = green.shape
    every_row = min(max(1, int(height * width // (effort * _LINE_PIXELS))), height, width)
    rows = np.ascontiguousarray(green[every_row // 2 :: every_row])
    columns = np.ascontiguousarray(green[:, every_row // 2 :: every_row].T)
    return np.concatenate([_spectrum(rows), _spectrum(columns)])


def _spectrum(lines: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return log power over 32 frequencies.

    Of the mean power, of the mean log power, and of the mean log power of the busiest segments,
    where little else than the blur limits the high frequencies.
    """
    windows = sliding_window_view(lines, _SEGMENT, axis=1)[:, :: _SEGMENT // 2]
    # A product a line: each is small enough for BLAS to stay on one thread.
    waves = (windows.astype(np.float32) @ _FOURIER).reshape(-1, _SEGMENT)
    np.square(waves, out=waves)
    power = waves[:, ::2] + waves[:, 1::2]
    log_power = np.log(power + FLOOR)
    busiest_last = np.argsort(power[:, 1:10].sum(axis=1))
    log_power = log_power[busiest_last]
    busy = [max(1, round(share * len(power))) for share in _BUSY_SHARES]
    return np.concatenate(
        [np.log(power.mean(axis=0) + FLOOR), log_power.mean(axis=0)]
        + [log_power[-count:].mean(axis=0) for count in busy]
    )


FEATURES = image_features(np.zeros((1, 1, 3), np.uint8)).size
"""How many features ``image_features`` returns."""
