"""The paper's identifier of the camera's noise level, to compare with.

Seven blocks of 3 × 3 convolution without padding, ReLU and 2 × 2 max pooling, channels
8-16-32-64-32-16-8, then one layer to the eleven levels; 53,187 parameters at 1600 × 900. Here it
sees a native crop from the middle instead of the whole frame, since two cores would train for
days on whole frames.

It is trained twice. As the paper writes: raw values of 0 to 255, Adam at 1e-4 throughout, cross
entropy. And with what was found to help it:

- With PyTorch's own initialisation its answers to two frames differ by 1e-4 at first, and most
  channels of the last block are dead. Weights start as He et al. propose ("Delving deep into
  rectifiers", ICCV 2015), on standardised values, the last layer at zero.
- Even so it was no better than chance after 7,000 crops: the last, narrow blocks go silent before
  the first ones have found any evidence. So the first five are trained alone on small windows,
  where a step costs little, then six, then all, at a rate that rises and falls.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from models.degrade.draw import DrawKey
from models.estimate.level import LEVELS
from models.estimate.network import softmax
from models.evaluate.codecs import Image
from models.training.camera_frames import (
    DEGRADED_PER_FRAME,
    MAIN_ONLY,
    Clean,
    make_samples,
)

try:
    import torch
    from torch.nn import functional

    from models.training.device import best_device
except ImportError:
    raise MissingExtra("train", "murk train camera --opponent") from None

if TYPE_CHECKING:
    from torch import Tensor

CROP = (384, 640)
"""Height and width of what the network sees, pixels."""

_CHANNELS = (3, 8, 16, 32, 64, 32, 16, 8)
_LAYERS_A_BLOCK = 3
_MEAN, _STD = 100.0, 80.0
_FRAMES_AT_ONCE = 80
_RATE_AS_WRITTEN = 1e-4


@dataclass(frozen=True, slots=True)
class Stage:
    """A stage of the training.

    Attributes
    ----------
    blocks:
        How many of the seven blocks are trained, with a layer of their own to the levels.
    window:
        Height and width of what they see, pixels.
    views:
        Windows of every crop, at random places, mirrored at random.
    batch:
        Windows in a step.
    peak_rate:
        To which the rate rises, and from which it falls to zero; None for the paper's throughout.
    passes:
        Over all frames, ``DEGRADED_PER_FRAME`` new crops of each.
    """

    blocks: int
    window: tuple[int, int]
    views: int
    batch: int
    peak_rate: float | None
    passes: int


GROWN = (
    Stage(blocks=5, window=(94, 94), views=16, batch=32, peak_rate=3e-3, passes=1),
    Stage(blocks=6, window=(190, 190), views=6, batch=16, peak_rate=2e-3, passes=1),
    Stage(blocks=7, window=CROP, views=2, batch=8, peak_rate=1e-3, passes=2),
)
"""First blocks first, on the smallest windows that they can see."""
AS_WRITTEN = (Stage(blocks=7, window=CROP, views=1, batch=8, peak_rate=None, passes=1),)
"""What the paper writes."""


class Standardise(torch.nn.Module):
    """Brings values of 0 to 255 to about zero mean and unit variance."""

    def forward(self, images: Tensor) -> Tensor:
        """Return images of the same shape."""
        return (images - _MEAN) / _STD


def paper_network(height: int, width: int) -> torch.nn.Sequential:
    """Return the paper's network for images of one size, values of 0 to 255."""
    return _with_last_layer(_blocks(), (height, width))


def _blocks() -> torch.nn.Sequential:
    """Return the seven blocks; pooling and ReLU commute, and pooling first is faster."""
    return torch.nn.Sequential(
        *(
            layer
            for before, after in pairwise(_CHANNELS)
            for layer in (torch.nn.Conv2d(before, after, 3), torch.nn.MaxPool2d(2), torch.nn.ReLU())
        )
    )


def _with_last_layer(blocks: torch.nn.Sequential, window: tuple[int, int]) -> torch.nn.Sequential:
    with torch.no_grad():
        inputs = blocks(torch.zeros(1, _CHANNELS[0], *window)).numel()
    network = torch.nn.Sequential(blocks, torch.nn.Flatten(), torch.nn.Linear(inputs, len(LEVELS)))
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def crop(image: Image) -> Image:
    """Return ``CROP`` pixels from the middle; a smaller image is mirrored at its edges."""
    height, width = CROP
    below, right = max(0, height - image.shape[0]), max(0, width - image.shape[1])
    if below or right:
        border = (below // 2, below - below // 2, right // 2, right - right // 2)
        image = np.asarray(cv2.copyMakeBorder(image, *border, cv2.BORDER_REFLECT_101), np.uint8)
    top, left = (image.shape[0] - height) // 2, (image.shape[1] - width) // 2
    return image[top : top + height, left : left + width]


def probabilities(network: torch.nn.Module, image: Image) -> NDArray[np.float64]:
    """Return (11,) what the network makes of one image of its size."""
    with torch.no_grad():
        logits = network(_as_input(image[np.newaxis]))
    return softmax(logits[0].numpy())


def fit_paper(
    frames: Sequence[Clean],
    seed: int,
    report: Callable[[dict[str, object]], None],
    *,
    as_written: bool = False,
    quick: bool = False,
) -> tuple[torch.nn.Module, int]:
    """Return the trained network and the number of crops that it learned from.

    Parameters
    ----------
    as_written:
        With no more than what the paper writes, instead of with all that helps.
    quick:
        Every stage in one pass, every crop once.
    """
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    blocks = _blocks()
    if not as_written:
        _start_as_he(blocks)
    crops = 0
    for stage in AS_WRITTEN if as_written else GROWN:
        used = replace(stage, passes=1, views=1) if quick else stage
        first = torch.nn.Sequential(*list(blocks)[: _LAYERS_A_BLOCK * stage.blocks])
        network = _with_last_layer(first, stage.window)
        if not as_written:
            for weights in network[-1].parameters():
                torch.nn.init.zeros_(weights)
            network.insert(0, Standardise())
        _fit_stage(network, used, frames, seed + crops, report)
        crops += used.passes * len(frames) * DEGRADED_PER_FRAME
    return network.eval(), crops


def _start_as_he(blocks: torch.nn.Sequential) -> None:
    for weights in blocks.parameters():
        if weights.ndim == 1:
            torch.nn.init.zeros_(weights)
        else:
            torch.nn.init.kaiming_normal_(weights, nonlinearity="relu")


def _fit_stage(
    network: torch.nn.Sequential,
    stage: Stage,
    frames: Sequence[Clean],
    seed: int,
    report: Callable[[dict[str, object]], None],
) -> None:
    parts = list(_parts(frames, stage.passes))
    optimizer = torch.optim.Adam(network.parameters(), _RATE_AS_WRITTEN)
    schedule: torch.optim.lr_scheduler.LRScheduler
    if stage.peak_rate is None:
        schedule = torch.optim.lr_scheduler.ConstantLR(optimizer, factor=1)
    else:
        steps = sum(-(-_crops(part) * stage.views // stage.batch) for part in parts)
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimizer, stage.peak_rate, total_steps=steps
        )
    device = best_device()
    network.to(device)
    seen = 0
    for number, part in enumerate(parts):
        rng = DrawKey(seed, "windows", number).generator("training")
        made = make_samples(part, 1, seed + number, recipe=MAIN_ONLY, describe=crop)
        levels = torch.from_numpy(np.rint(made.levels / 10).astype(np.int64)).to(device)
        order = rng.permutation(np.repeat(np.arange(len(levels)), stage.views))
        total = 0.0
        for batch in np.split(order, range(stage.batch, len(order), stage.batch)):
            windows = np.stack(
                [_window(made.features[index], stage.window, rng) for index in batch]
            )
            # Half precision costs nothing in accuracy here and takes half the time.
            with torch.autocast(device.type, torch.bfloat16):
                logits = network(_as_input(windows).to(device))
            loss = functional.cross_entropy(logits.float(), levels[batch])
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
            total += loss.item() * len(batch)
        seen += len(levels)
        of = sum(map(_crops, parts))
        report({"blocks": stage.blocks, "crops": seen, "of": of, "loss": total / len(order)})
    network.to("cpu")


def _crops(part: Sequence[Clean]) -> int:
    return len(part) * DEGRADED_PER_FRAME


def _window(image: Image, size: tuple[int, int], rng: np.random.Generator) -> Image:
    """Return a window at a random place, mirrored at random."""
    top, left = (
        int(rng.integers(have - want + 1)) for have, want in zip(image.shape, size, strict=False)
    )
    window = image[top : top + size[0], left : left + size[1]]
    return window[:, ::-1] if rng.random() < 0.5 else window


def _parts(frames: Sequence[Clean], passes: int) -> Iterator[list[Clean]]:
    """Yield all frames in every pass, shuffled, a few at once: all their crops fit no memory."""
    for turn in range(passes):
        order = DrawKey(0, "frames", turn).generator("order").permutation(len(frames))
        for first in range(0, len(frames), _FRAMES_AT_ONCE):
            yield [frames[index] for index in order[first : first + _FRAMES_AT_ONCE]]


def _as_input(images: NDArray[np.uint8]) -> Tensor:
    batch = torch.from_numpy(np.ascontiguousarray(images)).permute(0, 3, 1, 2).float()
    return batch.contiguous(memory_format=torch.channels_last)
