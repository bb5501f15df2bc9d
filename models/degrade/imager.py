"""Camera degradations of the imager and what drives it. N = level / 100.

===========  ==================================  ======================================
kind         what it does                        100 %
===========  ==================================  ======================================
motion       smear along one direction           40 px during the exposure
tunnel       exposure controller still adapted   4 stops off at the tunnel's mouth,
             to the other side, recovering       recovering with τ = 8 frames
poisson      shot and read noise                 20 counts an electron, read noise of
                                                 10 counts
salt_pepper  pixels stuck for one frame          a fifth of them, half white, half black
low_light    less light, half of it made up      6 stops less light, an image 3 stops
             for by gain, with its shot noise    darker with 125 electrons at white
jpeg         the codec's blocks                  quality 5, falling geometrically
dead         pixels and rows stuck for ever      1 % of the pixels, 1 % of the rows
===========  ==================================  ======================================
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from models.degrade.camera import Image, check_image
from models.degrade.checks import check_level
from models.degrade.draw import DrawKey
from models.degrade.pointwise import add_noise, bands, looked_up, words

KINDS = ("motion", "tunnel", "poisson", "salt_pepper", "low_light", "jpeg", "dead")

_SMEAR_PX = 40.0
_SMEAR_STEPS = 5
_SMEAR_BAND = 2**20
"""Bytes; each band is computed with as many rows more as the smear reaches."""

_TUNNEL_STOPS = 4.0
_TUNNEL_PERIOD = 100
_TUNNEL_TAU = 8.0
_COUNTS_PER_ELECTRON = 20.0
_READ_NOISE = 10.0
_STUCK_SHARE = 0.2
_LIGHT_STOPS = 6.0
_FULL_WELL = 8000.0
_READ_ELECTRONS = 3.0
_DEAD_SHARE = 0.01
_VALUES = np.arange(256, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Motion:
    """Smear of ``length`` pixels along ``direction_deg``, 0 along the rows."""

    kind: str
    level: float
    length: float
    direction_deg: float


@dataclass(frozen=True, slots=True)
class Gain:
    """Light times ``gain``."""

    kind: str
    level: float
    gain: float


@dataclass(frozen=True, slots=True)
class SignalNoise:
    """Light times ``gain``, then noise of variance ``shot * value + read**2``, counts²."""

    kind: str
    level: float
    gain: float
    shot: float
    read: float
    seed: int


@dataclass(frozen=True, slots=True)
class Stuck:
    """A share of the pixels, and of the rows, black or white, from ``seed``."""

    kind: str
    level: float
    pixel_share: float
    row_share: float
    seed: int


@dataclass(frozen=True, slots=True)
class Codec:
    """JPEG at ``quality``, 0 to 100."""

    kind: str
    level: float
    quality: int


ImagerDegradation = Motion | Gain | SignalNoise | Stuck | Codec


def draw(kind: str, level: float, key: DrawKey) -> ImagerDegradation:
    """Draw the parameters of one degradation of one image.

    ``tunnel`` runs by the key's sequence number: a mouth every 100 frames, out into the light and
    into the dark in turn. ``dead`` is the same for all frames of a sensor.

    Raises
    ------
    InputError
        If the kind is not one of ``KINDS`` or the level is not 0 to 100 %.
    """
    check_level(kind, level, KINDS)
    N = level / 100
    generator = key.generator(f"imager {kind}")
    seed = int(generator.bit_generator.random_raw())
    match kind:
        case "motion":
            return Motion(kind, level, N * _SMEAR_PX, generator.uniform(0, 180))
        case "tunnel":
            mouth, since = divmod(key.sequence, _TUNNEL_PERIOD)
            stops = N * _TUNNEL_STOPS * math.exp(-since / _TUNNEL_TAU)
            return Gain(kind, level, 2.0 ** (stops if mouth % 2 == 0 else -stops))
        case "poisson":
            return SignalNoise(kind, level, 1.0, N * _COUNTS_PER_ELECTRON, N * _READ_NOISE, seed)
        case "low_light":
            return _low_light(level, seed)
        case "salt_pepper":
            return Stuck(kind, level, N * _STUCK_SHARE, 0.0, seed)
        case "jpeg":
            return Codec(kind, level, round(100 * 0.05**N))
        case _:
            fixed = DrawKey(key.seed, key.sensor, 0).generator("imager dead")
            seed = int(fixed.bit_generator.random_raw())
            return Stuck(kind, level, N * _DEAD_SHARE, N * _DEAD_SHARE, seed)


def _low_light(level: float, seed: int) -> SignalNoise:
    """Return gain and noise of a sensor with a given full well in less light.

    Only the noise that comes on top of the well-lit image's own is added, so that level 0 adds
    none.
    """
    stops = level / 100 * _LIGHT_STOPS
    gain = 2.0 ** (-stops / 2)
    per_electron = gain * 255.0 / (_FULL_WELL * 2.0**-stops)
    own = gain * 255.0 / _FULL_WELL
    shot = gain * (per_electron - own)
    read = _READ_ELECTRONS * math.sqrt(per_electron**2 - own**2)
    return SignalNoise("low_light", level, gain, shot, read, seed)


def apply(degradation: ImagerDegradation, image: Image) -> Image:
    """Return the degraded image; the input stays as it is. At level 0 it is the image itself.

    Raises
    ------
    InputError
        If the image is not (height, width, 3) uint8.
    """
    check_image(image)
    if degradation.level == 0:
        return image
    match degradation:
        case Motion():
            return _smear(degradation, image)
        case Gain(gain=gain):
            return looked_up(image, np.clip(np.rint(gain * _VALUES), 0, 255).astype(np.uint8))
        case SignalNoise(gain=gain, shot=shot, read=read, seed=seed):
            return add_noise(image, np.sqrt(shot * _VALUES + read**2), gain * _VALUES, seed)
        case Stuck(kind="salt_pepper"):
            return _sprinkle(degradation, image)
        case Stuck():
            return _kill(degradation, image)
        case Codec(quality=quality):
            _, stream = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
            return decoded(stream)


def decoded(stream: NDArray[np.uint8]) -> Image:
    """Return the picture in a JPEG stream: the same to the bit as OpenCV's decoder gives.

    That one gets fresh pages from the system at every call, which takes as long as decoding.
    """
    picture = simplejpeg.decode_jpeg(
        stream.data, colorspace="BGR", fastdct=False, fastupsample=False
    )
    return np.asarray(picture, np.uint8)


def _smear(motion: Motion, image: Image) -> Image:
    """Average 32 copies along the smear: five times the mean of the image and itself moved."""
    angle = math.radians(motion.direction_deg)
    step = motion.length / 2**_SMEAR_STEPS
    moves = [
        (round(2**k * step * math.cos(angle)), round(2**k * step * math.sin(angle)))
        for k in range(_SMEAR_STEPS)
    ]
    moves = [(x, y) for x, y in moves if x or y]
    if not moves:
        return image
    reach_x, reach_y = (sum(abs(move[axis]) for move in moves) for axis in (0, 1))
    top, left = reach_y // 2, reach_x // 2
    height = len(image)
    result = np.empty(image.shape, np.uint8)
    for band in bands(image.shape, _SMEAR_BAND):
        here = result[band]
        first, last = band.start - top, band.start + len(here) + reach_y - top
        beyond = max(0, -first), max(0, last - height), left, reach_x - left
        rows = image[max(0, first) : last]
        padded = cv2.copyMakeBorder(rows, *beyond, borderType=cv2.BORDER_REFLECT)
        _average(np.asarray(padded, np.uint8), moves, here)
    return result


def _average(moved: Image, moves: list[tuple[int, int]], result: Image) -> None:
    """Put the mean of all copies that the moves make into ``result``; ``moved`` is used up."""
    spare = [np.empty_like(moved)] if len(moves) > 1 else []
    for x, y in moves[:-1]:
        here, there = _apart(moved, x, y)
        spare.append(moved)
        moved = spare.pop(0)[: here.shape[0], : here.shape[1]]
        cv2.addWeighted(here, 0.5, there, 0.5, 0, dst=moved)
    here, there = _apart(moved, *moves[-1])
    cv2.addWeighted(here, 0.5, there, 0.5, 0, dst=result)


def _apart(image: Image, x: int, y: int) -> tuple[Image, Image]:
    """Return what two copies of the image have in common when one is moved by (x, y)."""
    height, width = image.shape[0] - abs(y), image.shape[1] - abs(x)
    here = image[max(0, -y) :, max(0, -x) :][:height, :width]
    there = image[max(0, y) :, max(0, x) :][:height, :width]
    return here, there


def _sprinkle(stuck: Stuck, image: Image) -> Image:
    """Turn pixels white or black: the ends of a random 16-bit word decide."""
    flat = np.ascontiguousarray(image).reshape(1, -1, 3)
    edge = round(stuck.pixel_share / 2 * 65536)
    result = np.empty_like(flat)
    for part, fate in words(stuck.seed, flat.shape[1]):
        here = result[:, part]
        cv2.max(flat[:, part], _white_where(fate >= 65536 - edge), dst=here)
        cv2.min(here, _white_where(fate >= edge), dst=here)
    return np.asarray(result.reshape(image.shape), np.uint8)


def _white_where(mask: NDArray[np.bool_]) -> Image:
    """Return 255 where the mask holds and 0 elsewhere, in three channels."""
    return np.asarray(cv2.cvtColor(np.negative(mask.view(np.uint8)), cv2.COLOR_GRAY2BGR), np.uint8)


def _kill(stuck: Stuck, image: Image) -> Image:
    """Set the first so many pixels and rows of one fixed list: a higher level adds to them."""
    height, width = image.shape[:2]
    generator = np.random.SFC64(stuck.seed)
    most = math.ceil(_DEAD_SHARE * height * width)
    rows = np.argsort(generator.random_raw(height), kind="stable")
    places = generator.random_raw(most)
    result = image.copy()
    few = round(stuck.pixel_share * height * width)
    _stick(result.reshape(-1, 3), places[:few] % np.uint64(height * width), places[:few] >> 63)
    few = round(stuck.row_share * height)
    _stick(result, rows[:few], rows[:few] % 2)
    return result


def _stick(target: Image, index: NDArray[np.generic], bright: NDArray[np.generic]) -> None:
    shape = (-1, *[1] * (target.ndim - 1))
    target[index.astype(np.intp)] = np.where(bright.astype(bool), 255, 0).reshape(shape)
