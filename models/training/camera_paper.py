"""The paper's identifier of the camera's noise level, to compare with.

Seven blocks of 3 × 3 convolution without padding, ReLU and 2 × 2 max pooling, channels
8-16-32-64-32-16-8, then one layer to the eleven levels; 53,187 parameters at 1600 × 900. Here it
sees a native crop from the middle instead of the whole frame, since two cores would train for
days on whole frames.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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
from models.training.camera_frames import DEGRADED_PER_FRAME, MAIN_ONLY, Clean, make_samples

try:
    import torch
    from torch.nn import functional
except ImportError:
    raise MissingExtra("train", "murk train camera --opponent") from None

if TYPE_CHECKING:
    from torch import Tensor

CROP = (384, 640)
"""Height and width of what the network sees, pixels."""

_CHANNELS = (3, 8, 16, 32, 64, 32, 16, 8)
_BATCH = 8
_PEAK_RATE = 2e-3
_FRAMES_AT_ONCE = 40


def paper_network(height: int, width: int) -> torch.nn.Sequential:
    """Return the paper's network for images of one size."""
    blocks = [
        layer
        for before, after in pairwise(_CHANNELS)
        for layer in (torch.nn.Conv2d(before, after, 3), torch.nn.ReLU(), torch.nn.MaxPool2d(2))
    ]
    body = torch.nn.Sequential(*blocks, torch.nn.Flatten())
    with torch.no_grad():
        inputs = body(torch.zeros(1, 3, height, width)).shape[1]
    layers = torch.nn.Sequential(body, torch.nn.Linear(inputs, len(LEVELS)))
    return layers.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


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
    """Return (11,) what the network makes of one image."""
    with torch.no_grad():
        logits = network(_as_input(crop(image)[np.newaxis]))
    return softmax(logits[0].numpy())


def fit_paper(
    frames: Sequence[Clean],
    passes: int,
    seed: int,
    report: Callable[[dict[str, object]], None],
) -> tuple[torch.nn.Module, int]:
    """Return the trained network and the number of samples, each of which it saw once."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    network = paper_network(*CROP)
    samples = passes * len(frames) * DEGRADED_PER_FRAME
    steps = sum(-(-len(part) * DEGRADED_PER_FRAME // _BATCH) for part in _parts(frames, passes))
    optimizer = torch.optim.Adam(network.parameters())
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, _PEAK_RATE, total_steps=steps)
    seen = 0
    for number, part in enumerate(_parts(frames, passes)):
        made = make_samples(part, 1, seed + number, recipe=MAIN_ONLY, describe=crop)
        levels = torch.from_numpy(np.rint(made.levels / 10).astype(np.int64))
        total = 0.0
        for batch in torch.split(torch.randperm(len(levels)), _BATCH):
            logits = network(_as_input(made.features[batch.numpy()]))
            loss = functional.cross_entropy(logits, levels[batch])
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
            total += loss.item() * len(batch)
        seen += len(levels)
        report({"samples": seen, "of": samples, "loss": total / len(levels)})
    return network.eval(), samples


def _parts(frames: Sequence[Clean], passes: int) -> Iterator[list[Clean]]:
    """Yield all frames in every pass, shuffled, a few at once: all their crops fit no memory."""
    for turn in range(passes):
        order = DrawKey(0, "frames", turn).generator("order").permutation(len(frames))
        for first in range(0, len(frames), _FRAMES_AT_ONCE):
            yield [frames[index] for index in order[first : first + _FRAMES_AT_ONCE]]


def _as_input(images: NDArray[np.uint8]) -> Tensor:
    batch = torch.from_numpy(np.ascontiguousarray(images)).permute(0, 3, 1, 2).float() / 255
    return batch.contiguous(memory_format=torch.channels_last)
