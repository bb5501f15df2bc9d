"""Fine-tunes the shipped camera network on a user's own clean drives: ``murk train camera``.

Drives are videos, and folders of images, in a folder without murk's index. The last fifth of each
is left out of the training and tells what the tuning is worth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray

from dbc.errors import InputError
from drivers.camera import IMAGE_SUFFIXES, VIDEO_SUFFIXES, open_camera_source
from models.estimate.camera import VERSION, CameraEstimator
from models.estimate.exposure import SEEN
from models.estimate.level import FRAME_KINDS
from models.estimate.network import WEIGHTS
from models.evaluate.camera import Answers, measure
from models.training.camera_frames import DEGRADED_PER_FRAME, join, make_samples
from models.training.camera_history import make_successive
from models.training.camera_network import Perceptron, Successive, fit, fit_tunnel
from models.training.export import export

_MOST_FRAMES = 160
_LEAST_FRAMES = 5
_HELD_OUT = 0.2
_PASSES = 4
_EPOCHS = 10
_PEAK_RATE = 3e-4  # a tenth of the training's: the network is to learn, and not to forget
_DRAWS = 6

_CARD = """\
# Camera noise level, fine-tuned

The shipped network of version {version}, fine-tuned on {frames} frames of {drives} drives, each
degraded {passes} times {each}-fold; seed {seed}. Measured on the last fifth of each drive, which it
did not learn from: blur, over, under and noise in equal shares, levels uniform over the eleven.

| on {held_out} frames left out | level right | mean error, points |
|---|---|---|
| before | {before_right:.1%} | {before_error:.1f} |
| after | {after_right:.1%} | {after_error:.1f} |

How it was trained before stands in the card of the shipped network, and so do its limits. Frames
of other cameras were not seen in the tuning: on those, the shipped network may be the better one.
"""


@dataclass(frozen=True, slots=True, eq=False)
class DriveFrame:
    """One clean frame of a user's drive, in memory."""

    name: str
    image: NDArray[np.uint8]

    def read(self) -> NDArray[np.uint8]:
        """Return the image, (height, width, 3) uint8 BGR."""
        return self.image

    def read_repaired(self) -> None:
        """Return None: no pixel was repaired."""
        return


def find_drives(data: Path) -> list[Path]:
    """Return the videos in a folder and below it, and the folders that hold images, by name."""
    drives = {path for path in data.rglob("*") if path.suffix.lower() in VIDEO_SUFFIXES}
    drives |= {path.parent for path in data.rglob("*") if path.suffix.lower() in IMAGE_SUFFIXES}
    return sorted(drives)


def tune(
    data: Path, output: Path, *, quick: bool, seed: int, report: Callable[[dict[str, object]], None]
) -> dict[str, object]:
    """Fine-tune the shipped network, write it and its card, and return what it is worth.

    Parameters
    ----------
    data:
        Folder of clean drives.
    output, quick, seed, report:
        As for ``models.training.camera.train``.

    Raises
    ------
    InputError
        If there is no drive, or too few frames.
    """
    drives = find_drives(data)
    if not drives:
        expected = "expected videos or folders of images, or camera/index.csv"
        raise InputError(data, "holds no drive", expected)
    most = max(_LEAST_FRAMES, (20 if quick else _MOST_FRAMES) // len(drives))
    learnt: list[DriveFrame] = []
    held_out: list[DriveFrame] = []
    for drive in drives:
        frames = _read(drive, most)
        kept = len(frames) - max(1, round(_HELD_OUT * len(frames)))
        learnt += frames[:kept]
        held_out += frames[kept:]
    if len(learnt) < _LEAST_FRAMES:
        raise InputError(data, f"has {len(learnt)} frames", f"at least {_LEAST_FRAMES}")
    report({"drives": len(drives), "frames": len(learnt), "held_out": len(held_out)})
    passes = 1 if quick else _PASSES
    # In this process: the frames are in memory, too much to hand to others.
    samples = join([make_samples(learnt, passes=1, seed=seed + turn) for turn in range(passes)])
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    network = shipped_network()
    fit(network.image, samples, epochs=_EPOCHS, peak_rate=_PEAK_RATE, report=report)
    successive, histories = make_successive(learnt, passes=1, seed=seed)
    fit_tunnel(network, successive, histories, epochs=_EPOCHS, peak_rate=_PEAK_RATE, report=report)
    export(
        network,
        {"features": torch.zeros(1, len(network.image.mean)), "history": torch.zeros(1, SEEN)},
        output,
        model="camera",
        version=VERSION,
        kinds=FRAME_KINDS,
    )
    before, after = (
        measure(CameraEstimator(path).estimate, held_out, draws=_DRAWS, seed=seed)
        for path in (None, output)
    )
    card = _CARD.format(
        version=VERSION,
        frames=len(learnt),
        drives=len(drives),
        passes=passes,
        each=DEGRADED_PER_FRAME,
        seed=seed,
        held_out=len(held_out),
        before_right=_all(before)["accuracy"],
        before_error=_all(before)["mean_error"],
        after_right=_all(after)["accuracy"],
        after_error=_all(after)["mean_error"],
    )
    output.with_suffix(".md").write_text(card, encoding="utf-8")
    return {
        "output": str(output),
        "frames": len(learnt),
        "before": before.table(),
        "after": after.table(),
    }


def shipped_network() -> Successive:
    """Return the network that murk ships, to be trained further."""
    weights = {
        tensor.name: torch.from_numpy(onnx.numpy_helper.to_array(tensor).copy())
        for tensor in onnx.load(WEIGHTS / "camera.onnx").graph.initializer
    }
    network = Successive(Perceptron(weights["image.mean"], weights["image.std"]))
    network.load_state_dict({name: weights[name] for name in network.state_dict()})
    return network


def _read(drive: Path, most: int) -> list[DriveFrame]:
    """Return frames of a drive, spread evenly: at most twice ``most`` while reading."""
    frames: list[DriveFrame] = []
    every = 1
    with open_camera_source(drive, drive.name) as source:
        for frame in source:
            if frame.sequence % every == 0:
                frames.append(DriveFrame(f"{drive.name} {frame.sequence}", frame.image))
            if len(frames) == 2 * most:
                frames, every = frames[::2], 2 * every
    keep = np.linspace(0, len(frames) - 1, min(most, len(frames))).astype(int)
    return [frames[index] for index in keep]


def _all(answers: Answers) -> dict[str, float]:
    return answers.table()["all"]
