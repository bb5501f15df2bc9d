"""The lens's network and how it learns: what stands still, from averages over successive looks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from models.estimate.lens import BANDS, CHANNELS, LOG_RATIOS

try:
    import torch
    from torch.nn import functional

    from models.training.descend import Report, descend
    from models.training.device import best_device
except ImportError:
    raise MissingExtra("train", "murk train lens") from None

if TYPE_CHECKING:
    from torch import Tensor

CLEAN = 0
"""Index of a lens that has nothing on it among the answers; the kinds' levels follow in turn."""

_SEEN = 12
_POOLED = 16
_AROUND = 8
_COLUMNS = 96
_BATCH = 64
_WEIGHT_DECAY = 2e-2
_RANKED_WEIGHT = 0.7
_CLEAN_WEIGHT = 2.0
_CLEAN_TO_A_LEVEL = 40.0  # of eight samples four are clean and count twice, two of a kind
_MIDDLE = (-1.0, 6.0, 0.5, 0.5, 0.5)
_SPREAD = (1.5, 2.0, 0.5, 0.5, 1.0)


class Lens(torch.nn.Module):
    """Looks at every cell of the map and its neighbours in the same way, and pools what it sees.

    Beside the map itself it sees how far log detail and log brightness are from the mean of the
    cells around in the same row, and how high in the frame a cell is.
    """

    middle: Tensor
    spread: Tensor
    height: Tensor
    temperature: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("middle", torch.tensor(_MIDDLE).reshape(1, -1, 1, 1))
        self.register_buffer("spread", torch.tensor(_SPREAD).reshape(1, -1, 1, 1))
        self.register_buffer("height", torch.linspace(-1, 1, BANDS).reshape(1, 1, -1, 1))
        self.register_buffer("temperature", torch.ones(()))
        self.look = torch.nn.Sequential(
            torch.nn.Conv2d(CHANNELS + 3, _SEEN, kernel_size=(1, 5), padding=(0, 2)),
            torch.nn.SiLU(),
            torch.nn.Conv2d(_SEEN, _SEEN, kernel_size=(1, 5), padding=(0, 2)),
            torch.nn.SiLU(),
            torch.nn.Conv2d(_SEEN, _SEEN, kernel_size=3, padding=1),
            torch.nn.SiLU(),
            torch.nn.Conv2d(_SEEN, _POOLED, kernel_size=1),
            torch.nn.SiLU(),
        )
        self.answer = torch.nn.Sequential(
            torch.nn.Dropout(0.1),
            torch.nn.Linear(3 * _POOLED, 32),
            torch.nn.SiLU(),
            torch.nn.Linear(32, 1 + LOG_RATIOS[0] * LOG_RATIOS[1]),
        )

    def joint(self, maps: Tensor) -> Tensor:
        """Return logits of clean and of each kind and level, (batch, 21), by the samples' odds."""
        standard = (maps - self.middle) / self.spread
        sides = functional.pad(standard[:, :2], (_AROUND, _AROUND, 0, 0), mode="reflect")
        around = functional.avg_pool2d(sides, (1, 2 * _AROUND + 1), stride=1)
        height = self.height + torch.zeros_like(standard[:, :1])
        seen = self.look(torch.cat([standard, standard[:, :2] - around, height], dim=1))
        pooled = [seen.mean(dim=(2, 3)), seen.square().mean(dim=(2, 3)), seen.amax(dim=(2, 3))]
        return self.answer(torch.cat(pooled, dim=1))

    def forward(self, maps: Tensor) -> Tensor:
        """Return log likelihoods (batch, 2, 10) against a clean lens: without the samples' odds."""
        logits = self.joint(maps) / self.temperature
        ratios = logits[:, 1:] - logits[:, :1] + math.log(_CLEAN_TO_A_LEVEL)
        return ratios.reshape(-1, *LOG_RATIOS)


def fit(
    network: Lens,
    maps: Sequence[NDArray[np.float16]],
    answers: NDArray[np.int64],
    *,
    epochs: int,
    peak_rate: float,
    report: Report,
) -> None:
    """Train a network, which ends in the state of evaluation; the rate rises and falls once.

    Parameters
    ----------
    maps:
        (5, 16, columns) each, as ``models.estimate.lens.lens_input`` returns them.
    answers:
        The right index of what ``Lens.joint`` returns, (n,).
    epochs:
        After each of which ``report`` gets a record of the progress.
    """
    device = best_device()
    network.to(device)
    right = torch.from_numpy(answers).to(device)

    def loss_of(batch: Tensor) -> Tensor:
        windows = torch.stack([_window(maps[index]) for index in batch.tolist()])
        return _loss(network.joint(windows.to(device)), right[batch])

    network.train()
    descend(
        torch.optim.AdamW(network.parameters(), weight_decay=_WEIGHT_DECAY),
        loss_of,
        len(maps),
        batch=_BATCH,
        epochs=epochs,
        peak_rate=peak_rate,
        report=report,
    )
    network.to("cpu").eval()


def _window(a_map: NDArray[np.float16]) -> Tensor:
    """Return a part of a map of as many columns as all others in a batch, mirrored at times."""
    whole = torch.from_numpy(a_map).float()
    columns = whole.shape[2]
    if columns < _COLUMNS:
        whole = whole.repeat(1, 1, -(-_COLUMNS // columns))
    first = int(torch.randint(whole.shape[2] - _COLUMNS + 1, ()))
    window = whole[:, :, first : first + _COLUMNS]
    return window.flip(2) if torch.rand(()) < 0.5 else window


def _loss(logits: Tensor, right: Tensor) -> Tensor:
    """Return the cross entropy and, as the levels are ordered, the ranked probability score."""
    log = logits.log_softmax(dim=1)
    losses = -log[torch.arange(len(right)), right]
    truth = functional.one_hot(right, log.shape[1])[:, 1:].reshape(-1, *LOG_RATIOS)
    apart = log.exp()[:, 1:].reshape(-1, *LOG_RATIOS).cumsum(dim=2) - truth.cumsum(dim=2)
    losses = losses + _RANKED_WEIGHT * apart.square().sum(dim=(1, 2))
    weights = torch.where(right == CLEAN, _CLEAN_WEIGHT, 1.0)
    return (weights * losses).sum() / weights.sum()
