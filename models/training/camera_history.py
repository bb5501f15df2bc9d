"""Frames with what the same camera might have seen before them, to learn a tunnel's mouth from.

A network that only ever saw clean frames before degraded ones would take every jump for a
degradation, and a steady one for none. So what was before is a frame exposed as this one is, the
same frame degraded otherwise or not at all, or another scene; and it drifts, as a real camera's
does.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context

import cv2
import numpy as np
from numpy.typing import NDArray

from models.degrade.draw import DrawKey
from models.degrade.imager import Gain, draw
from models.estimate.exposure import SEEN, ExposureHistory, seen_before
from models.estimate.image_features import exposure, exposures, image_features
from models.estimate.level import FRAME_KINDS, IMAGE_KINDS, LEVELS
from models.evaluate.camera import degrade, tunnel_sequence
from models.evaluate.codecs import Image
from models.training.camera_frames import Clean, Samples, join
from models.training.camera_vary import compress, vary

Exposure = NDArray[np.float64]

SHOTS = ("clean", "clean", "tunnel", "tunnel", "tunnel", "tunnel", "over", "over", "under", "under")
"""Kinds of the samples of every frame; three of any kind come to these."""
OTHER_SHOTS = 3

_DRAWS = 6
_SHARE_COMPRESSED = 0.12
_SHARE_STEADY = 0.35
_SHARE_ELSEWHERE = 0.15
_MOST_CHANGES = 4
_RATES_HZ = (5.0, 60.0)
_MOST_FRAMES = 150
_STRIDES = (1, 1, 1, 1, 1, 1, 2, 3, 4)
"""Frames from one look to the next; a steady camera is not looked at every time."""
_JITTER = 0.2
_DRIFT_PER_S = np.array([0.12, 0.12, 0.12, 0.12, 0.12, 0.008, 0.012])
"""Standard deviation of each measure's own change in the first second.

Of three real clips: 0.01 to 0.1 in log2 of brightness by day, 0.1 to 0.9 by night, whose lights
come and go; shares of black and clipped 0.002 to 0.03. So the strength is drawn log-normally."""
_DRIFT_OF_ALL = 0.08
"""The same of what all five brightnesses have in common, as an exposure controller moves them."""
_DRIFT_SPREAD = 1.0
_DRIFT_LASTS_S = 5.0
_ELSEWHERE = np.array([0.6, 0.6, 0.6, 0.6, 0.6, 0.05, 0.05])
"""Standard deviations of the measures from scene to scene."""
_STOPS = 0.5
_COUNTS_LOG2 = (np.log2(0.5), np.log2(255.5))


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """When the frames before one were looked at, oldest first.

    Attributes
    ----------
    back:
        How many frames before it each was, (k,), > 0.
    stamps_ns:
        Their moments of capture; its own is 0.
    """

    back: NDArray[np.intp]
    stamps_ns: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class _Shot:
    """A degraded frame: kind, level, number, features and exposure."""

    kind: str
    level: float
    sequence: int
    features: NDArray[np.float32]
    exposed: Exposure


def make_successive(
    frames: Sequence[Clean], passes: int, seed: int
) -> tuple[Samples, NDArray[np.float32]]:
    """Return samples of every frame in every pass, each varied anew, and histories of each.

    Returns
    -------
    samples:
        ``SHOTS`` and ``OTHER_SHOTS`` of every frame.
    histories:
        (n, 6, 41) float32, several of each sample, as ``seen_before`` returns them.
    """
    one_pass = partial(_make_pass, frames, seed)
    if passes == 1:
        return one_pass(0)
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        samples, histories = zip(*pool.map(one_pass, range(passes)), strict=True)
    return join(samples), np.concatenate(histories)


def _make_pass(
    frames: Sequence[Clean], seed: int, turn: int
) -> tuple[Samples, NDArray[np.float32]]:
    cv2.setNumThreads(1)
    shots: list[_Shot] = []
    histories = []
    for frame in frames:
        rng = DrawKey(seed, frame.name, turn).generator("successive")
        clean = vary(frame.read(), frame.read_repaired(), rng)
        kinds = [*SHOTS, *rng.choice(IMAGE_KINDS[1:], OTHER_SHOTS).tolist()]
        own = [_shoot(clean, kind, rng) for kind in kinds]
        shots += own
        for shot in own:
            histories += [_history(shot, clean, own, rng) for _ in range(_DRAWS)]
    samples = Samples(
        np.array([shot.features for shot in shots]),
        np.array([shot.level for shot in shots], np.float32),
        np.array([FRAME_KINDS.index(shot.kind) for shot in shots]),
    )
    return samples, np.array(histories).reshape(len(shots), _DRAWS, SEEN)


def _shoot(clean: Image, kind: str, rng: np.random.Generator) -> _Shot:
    level = 0.0 if kind == "clean" else float(rng.choice(LEVELS[1:]))
    sequence = tunnel_sequence(rng)
    key = DrawKey(int(rng.integers(2**31)), "successive", sequence)
    kind, image = degrade(kind, level, key, clean)
    if rng.random() < _SHARE_COMPRESSED:
        image = compress(image, rng)
    features = image_features(image)
    return _Shot(kind, level, sequence, features, exposure(features))


def _history(
    shot: _Shot, clean: Image, same_frame: Sequence[_Shot], rng: np.random.Generator
) -> NDArray[np.float32]:
    looks = draw_looks(rng)
    if shot.kind == "tunnel":
        before = in_tunnel(looks, clean, shot.level, shot.sequence)
    else:
        before = np.tile(shot.exposed, (len(looks.back), 1))
        chance = rng.random()
        if chance < _SHARE_ELSEWHERE:
            before = changed(looks, before, [_elsewhere(shot.exposed, rng)], rng)
        elif chance < 1 - _SHARE_STEADY:
            steady = [other.exposed for other in same_frame if other.kind != "tunnel"]
            before = changed(looks, before, steady, rng)
    return _seen(looks, before, shot.exposed, rng)


def draw_looks(rng: np.random.Generator) -> Looks:
    """Return looks at a camera of any usual rate, from one frame to half a minute of them."""
    period_s = 1 / np.exp(rng.uniform(*np.log(_RATES_HZ)))
    count = int(np.exp(rng.uniform(0, np.log(_MOST_FRAMES))))
    back = int(rng.choice(_STRIDES)) * np.arange(count, 0, -1)
    late = rng.uniform(-_JITTER, _JITTER, count)
    return Looks(back, ((late - back) * period_s * 1e9).astype(np.int64))


def changed(
    looks: Looks, before: Exposure, states: Sequence[Exposure], rng: np.random.Generator
) -> Exposure:
    """Return (k, 7) of a scene that was exposed otherwise, once or several times in turn.

    Parameters
    ----------
    before:
        (k, 7) of the same looks if nothing had changed; the newest part of it stays.
    states:
        Exposures, (7,) each, that it may have had.
    """
    before = before.copy()
    changes = int(rng.integers(1, _MOST_CHANGES + 1))
    for since in np.sort(np.exp(rng.uniform(0, np.log(2 * _MOST_FRAMES), changes))).tolist():
        before[looks.back >= since] = states[int(rng.integers(len(states)))]
    return before


def _elsewhere(exposed: Exposure, rng: np.random.Generator) -> Exposure:
    """Return the exposure of another scene that the same camera might have seen."""
    other = exposed + rng.normal(0, _ELSEWHERE)
    other[:5] = np.sort(other[:5] + rng.normal(0, _ELSEWHERE[0]))
    return other


def in_tunnel(looks: Looks, clean: Image, level: float, sequence: int) -> Exposure:
    """Return (k, 7) of the frames before one in a tunnel's transient.

    Parameters
    ----------
    clean:
        The frame as it is without the tunnel.
    level, sequence:
        Of the transient, %, and the frame's number, as ``models.degrade.imager`` counts; more than
        the looks go back.
    """
    stops = np.array([_stops(level, sequence - back) for back in looks.back.tolist()])
    ends = min(stops.min(), 0.0), max(stops.max(), 0.0)
    grid = np.linspace(*ends, 2 + int((ends[1] - ends[0]) / _STOPS))
    gained = np.clip(np.rint(2.0 ** grid[:, np.newaxis] * np.arange(256)), 0, 255)
    exposed = exposures(clean, gained.astype(np.uint8))
    return np.stack([np.interp(stops, grid, column) for column in exposed.T], axis=1)


def _stops(level: float, sequence: int) -> float:
    drawn = draw("tunnel", level, DrawKey(0, "", sequence))
    return float(np.log2(drawn.gain)) if isinstance(drawn, Gain) else 0.0


def _seen(
    looks: Looks, before: Exposure, now: Exposure, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Return what is told of the frames before one, of a camera in motion."""
    drifted = before + _drift(looks.stamps_ns, rng)
    drifted[:, :5] = np.clip(drifted[:, :5], *_COUNTS_LOG2)
    drifted[:, 5:] = np.clip(drifted[:, 5:], 0, 1)
    history = ExposureHistory.begin(int(looks.stamps_ns[0]), drifted[0])
    for stamp_ns, exposed in zip(looks.stamps_ns[1:].tolist(), drifted[1:], strict=True):
        history = history.after(stamp_ns, exposed)
    return seen_before(history, 0, now)


def _drift(stamps_ns: NDArray[np.int64], rng: np.random.Generator) -> Exposure:
    """Return (k, 7) how far each measure was from now: Ornstein and Uhlenbeck's, back in time."""
    strength = np.exp(rng.normal(0, _DRIFT_SPREAD))
    keep = np.exp(np.diff(stamps_ns, append=0) * -1e-9 / _DRIFT_LASTS_S)[::-1]
    own = rng.standard_normal((len(keep), len(_DRIFT_PER_S))) * _DRIFT_PER_S
    own[:, :5] += _DRIFT_OF_ALL * rng.standard_normal((len(keep), 1))
    kicks = strength * own * np.sqrt(_DRIFT_LASTS_S / 2 * (1 - keep**2))[:, np.newaxis]
    away = np.empty_like(kicks)
    last = np.zeros(kicks.shape[1])
    for index, (fade, kick) in enumerate(zip(keep, kicks, strict=True)):
        last = away[index] = fade * last + kick
    return away[::-1]
