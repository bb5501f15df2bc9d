"""The paper's network for a radar scan: an opponent of murk's.

Eighteen raw columns a cluster, pointwise convolutions 32-64-128, the mean over the clusters, dense
layers 64-32-11, cross entropy: 21,739 parameters. The columns of the quality fields are 0, because
the injector leaves those fields as they were and they would betray it. Standardised columns, and
Adam at 1e-3 instead of the paper's 1e-4, at which it learns next to nothing from so few steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from drivers.scan import RadarScan
from models.estimate.level import LEVELS
from models.estimate.network import softmax
from models.estimate.radar_view import view

try:
    import torch
    from torch import Tensor
    from torch.nn import functional
except ImportError:
    raise MissingExtra("train", "murk train radar --opponent") from None

_COLUMNS = 18
_EPOCHS, _BATCH, _RATE = 4, 64, 1e-3


class PaperNetwork(torch.nn.Module):
    """The paper's network.

    Parameters
    ----------
    mean, std:
        Of the training clusters, (18,) each.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, mean: Tensor, std: Tensor) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("std", std)
        self.points = _layers(_COLUMNS, 32, 64, 128)
        self.whole = torch.nn.Sequential(*_layers(128, 64, 32), torch.nn.Linear(32, len(LEVELS)))

    def forward(self, scans: Sequence[Tensor]) -> Tensor:
        """Return logits (scans, 11) of scans of (n, 18) clusters."""
        count = torch.tensor([len(scan) for scan in scans])
        owner = torch.repeat_interleave(torch.arange(len(scans)), count)
        seen = self.points((torch.cat(list(scans)) - self.mean) / self.std)
        total = torch.zeros(len(scans), seen.shape[1]).index_add(0, owner, seen)
        logits: Tensor = self.whole(total / count[:, None])
        return logits


def raw_columns(scan: RadarScan) -> NDArray[np.float32]:
    """Return what the network sees of each cluster, (n, 18).

    x, y, z, DynProp, ID, RCS, velocity, velocity over ground, and eight of quality, which are 0.
    """
    seen = view(scan)
    over_ground = seen.velocity - seen.motion.velocity(seen.position)
    columns = np.zeros((len(scan), _COLUMNS), np.float32)
    columns[:, :2] = seen.position.T
    columns[:, 3] = seen.still
    columns[:, 4] = np.arange(len(scan))
    columns[:, 5] = seen.rcs
    columns[:, 6:8] = seen.velocity.T
    columns[:, 8:10] = over_ground.T
    return columns


def fit_paper(
    scans: Sequence[NDArray[np.float32]], levels: NDArray[np.int64], seed: int
) -> PaperNetwork:
    """Train the network on the columns of scans and their levels, by index."""
    torch.manual_seed(seed)
    clusters = [torch.from_numpy(scan) for scan in scans]
    every = torch.cat(clusters)
    network = PaperNetwork(every.mean(dim=0), every.std(dim=0) + 1e-3)
    optimizer = torch.optim.Adam(network.parameters(), lr=_RATE)
    truth = torch.from_numpy(levels)
    for _ in range(_EPOCHS):
        for batch in torch.split(torch.randperm(len(clusters)), _BATCH):
            logits = network([clusters[i] for i in batch])
            loss = functional.cross_entropy(logits, truth[batch])
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
    return network


def probabilities(network: PaperNetwork, columns: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return (11,) what the network says of the columns of at least one cluster."""
    with torch.no_grad():
        return softmax(network([torch.from_numpy(columns)])[0].numpy())


def _layers(*widths: int) -> torch.nn.Sequential:
    layers: list[torch.nn.Module] = []
    for before, after in pairwise(widths):
        layers += [torch.nn.Linear(before, after), torch.nn.ReLU()]
    return torch.nn.Sequential(*layers)
