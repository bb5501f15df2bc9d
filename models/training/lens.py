"""Trains the lens's network: ``murk train lens``.

It learns from successive views with a clean lens, with drops, with dirt, and with other kinds of
degradation, none of which stands still on the lens.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from models.degrade.draw import DrawKey
from models.estimate.camera import CameraEstimator
from models.estimate.lens import LOG_RATIOS, VERSION, LensHistory, lens_input
from models.estimate.level import LENS_KINDS, LEVELS
from models.evaluate.camera import CleanFrame, degrade
from models.evaluate.codecs import Image, jpeg
from models.evaluate.lens import lens_table
from models.training.camera_frames import read_splits
from models.training.lens_views import Views, driven_views, simulated_views, successive_views

try:
    import torch

    from models.training.export import export
    from models.training.lens_card import write_card
    from models.training.lens_network import CLEAN, Lens, fit
except ImportError:
    raise MissingExtra("train", "murk train lens") from None

Report = Callable[[dict[str, object]], None]

_PASSES = 4
_EPOCHS = 16
_PEAK_RATE = 6e-3
_SUCCESSIVE = ("camvid_0016E5", "camvid_0006R0")
"""Scenes of the data whose frames were taken one after the other, every two seconds."""
_AS_IF_S = 0.5
"""Time from one of these to the next as it is taken to be, s: as of a faster drive."""
_SUCCESSIVE_EVERY = 4
_FRAMES_A_WORLD = 30
_FIRST_WORLD = {"train": 2_000_000, "val": 3_000_000}
_OTHER_KINDS = ("blur", "over", "under", "noise", "low_light", "fog", "rain", "snow", "motion")
_SHARE_CLEAN = 0.75
_ON_THE_LENS = ("drops", "drops", "dirt", "dirt")
_RATES_HZ = (5.0, 30.0)
_MOST_NOISE = 2.5
_SHARE_NOISY = 0.3
_SHARE_JPEG = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class LensSamples:
    """Training samples.

    Attributes
    ----------
    maps:
        (5, 16, columns) float16 each, as ``models.estimate.lens.lens_input`` returns them.
    answers:
        The right index of the network's joint answer, (n,).
    """

    maps: list[NDArray[np.float16]]
    answers: NDArray[np.int64]


def train(data: Path, output: Path, *, quick: bool, seed: int, report: Report) -> dict[str, object]:
    """Train the lens's network, write it and its card, and return what it reaches.

    Deterministic on one machine: the same data and seed give the same file.

    Parameters
    ----------
    data:
        Folder with ``camera/index.csv``.
    output:
        ONNX file to write; its card goes beside it with the suffix ``.md``.
    quick:
        A few frames and one pass, in seconds: to see that it runs, not to be used.
    seed:
        Of the views, the degradations and the network.
    report:
        Called with a record of the progress after every epoch.

    Raises
    ------
    InputError
        If the data lack something.
    """
    splits = read_splits(data, ("train", "val"), quick=quick)
    passes = 1 if quick else _PASSES
    samples = make_samples(splits["train"], "train", passes, seed)
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    network = Lens()
    epochs = 1 if quick else _EPOCHS
    fit(network, samples.maps, samples.answers, epochs=epochs, peak_rate=_PEAK_RATE, report=report)
    held_out = make_samples(splits["val"], "val", passes, seed)
    calibrate(network, held_out)
    example = {"lens": torch.from_numpy(samples.maps[0].astype(np.float32)[np.newaxis])}
    export(
        network,
        example,
        output,
        model="lens",
        version=VERSION,
        outputs=("log_ratios",),
        free={"lens": {3: "columns"}},
    )
    table = lens_table(CameraEstimator(lens=output), data, quick=quick)
    parameters = sum(parameter.numel() for parameter in network.parameters())
    write_card(
        output.with_suffix(".md"),
        frames=splits["train"],
        samples=len(samples.maps),
        parameters=parameters,
        temperature=float(network.temperature),
        seed=seed,
        table=table,
    )
    return {
        "output": str(output),
        "samples": len(samples.maps),
        "parameters": parameters,
        "temperature": float(network.temperature),
    }


def make_samples(frames: Sequence[CleanFrame], split: str, passes: int, seed: int) -> LensSamples:
    """Return samples of every frame in every pass: of a third of the views, and of all.

    They depend on the arguments only, not on the number of processors that share the passes.
    """
    one_pass = partial(_make_pass, frames, split, seed)
    if passes == 1:
        return one_pass(0)
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        parts = list(pool.map(one_pass, range(passes)))
    maps = [one for part in parts for one in part.maps]
    return LensSamples(maps, np.concatenate([part.answers for part in parts]))


def _make_pass(frames: Sequence[CleanFrame], split: str, seed: int, turn: int) -> LensSamples:
    cv2.setNumThreads(1)
    maps, answers = [], []
    for name, make in _makers(frames, split, turn):
        rng = DrawKey(seed, f"{split} {name}", turn).generator("lens")
        views = make(rng)
        others = np.where(rng.random(4) < _SHARE_CLEAN, "clean", rng.choice(_OTHER_KINDS, 4))
        kinds = [*_ON_THE_LENS, *others.tolist()]
        level_of = rng.choice(LEVELS[1:], len(kinds)).tolist()
        spoil = _spoiler(views.images[0].shape, rng)
        for kind, level in zip(kinds, level_of, strict=True):
            first, step = int(rng.integers(1000, 5000)), _frames_a_look(views.spacing_s, rng)
            keys = [
                DrawKey(seed, f"{name} {turn}", first + look * step)
                for look in range(len(views.images))
            ]
            shown = [
                spoil(degrade(kind, level if kind != "clean" else 0.0, key, image)[1])
                for key, image in zip(keys, views.images, strict=True)
            ]
            maps += _maps(shown, views.spacing_s)
            answers += [_answer(kind, level)] * 2
    return LensSamples(maps, np.array(answers))


def _makers(
    frames: Sequence[CleanFrame], split: str, turn: int
) -> list[tuple[str, Callable[[np.random.Generator], Views]]]:
    """Return names of views, and what makes them."""
    alike: dict[str, list[CleanFrame]] = {}
    for frame in frames:
        alike.setdefault(_place(frame), []).append(frame)
    makers: list[tuple[str, Callable[[np.random.Generator], Views]]] = [
        (frame.name, partial(driven_views, frame, alike[_place(frame)])) for frame in frames
    ]
    for scene in _SUCCESSIVE:
        in_turn = alike.get(scene, [])
        for first in range(turn % _SUCCESSIVE_EVERY, len(in_turn) - 1, _SUCCESSIVE_EVERY):
            part = in_turn[first:]
            makers.append((f"{scene} {first}", partial(successive_views, part, _AS_IF_S)))
    worlds = len(frames) // _FRAMES_A_WORLD
    for world in range(turn * worlds, (turn + 1) * worlds):
        seed = _FIRST_WORLD[split] + world
        makers.append((f"world {world}", partial(simulated_views, seed)))
    return makers


def _place(frame: CleanFrame) -> str:
    """Return what frames that may follow each other have in common: a scene, or a source."""
    return frame.scene if frame.scene in _SUCCESSIVE else frame.source


def _frames_a_look(spacing_s: float, rng: np.random.Generator) -> int:
    return max(1, round(spacing_s * float(rng.uniform(*_RATES_HZ))))


def _spoiler(shape: tuple[int, ...], rng: np.random.Generator) -> Callable[[Image], Image]:
    """Return what the sensor and the codec do to every view: noise, JPEG, or neither."""
    strength = rng.uniform(0, _MOST_NOISE) if rng.random() < _SHARE_NOISY else 0.0
    quality = int(rng.integers(75, 97)) if rng.random() < _SHARE_JPEG else None
    noise = np.rint(strength * rng.standard_normal(shape, np.float32)).astype(np.int16)

    def spoil(image: Image) -> Image:
        if strength:  # of one field, moved at random: to draw one for every view takes too long
            own = np.roll(noise, rng.integers(0, shape[:2]), axis=(0, 1))
            image = np.asarray(cv2.add(image, own, dtype=cv2.CV_8U), np.uint8)
        return image if quality is None else jpeg(image, quality)

    return spoil


def _maps(images: Sequence[Image], spacing_s: float) -> list[NDArray[np.float16]]:
    """Return the network's input after a third of the looks, at least two, and after all."""
    stamps_ns = [round(look * spacing_s * 1e9) for look in range(len(images))]
    history = LensHistory.begin(0, images[0])
    histories = [history]
    for stamp_ns, image in zip(stamps_ns[1:], images[1:], strict=True):
        history = history.after(stamp_ns, image)
        histories.append(history)
    ends = max(1, len(images) // 3), len(images) - 1
    return [lens_input(histories[end]).astype(np.float16) for end in ends]


def _answer(kind: str, level: float) -> int:
    """Return the index of the right answer, of a level among ``LEVELS``."""
    if kind not in LENS_KINDS:
        return CLEAN
    return LENS_KINDS.index(kind) * LOG_RATIOS[1] + int(np.searchsorted(LEVELS, level))


def calibrate(network: Lens, samples: LensSamples) -> None:
    """Set the temperature that makes the truth of held-out views most likely."""
    with torch.no_grad():
        logits = torch.cat(
            [network.joint(torch.from_numpy(one.astype(np.float32))[None]) for one in samples.maps]
        )
    right = torch.from_numpy(samples.answers)
    candidates = torch.from_numpy(np.geomspace(0.5, 4, 61).astype(np.float32))
    surprise = [
        torch.nn.functional.cross_entropy(logits / candidate, right) for candidate in candidates
    ]
    network.temperature.fill_(candidates[int(torch.stack(surprise).argmin())])
