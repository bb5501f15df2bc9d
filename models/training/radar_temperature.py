"""How sure the radar's network may be: a temperature for every window.

The logits of the level are divided by a temperature, which leaves their order as it is. One for all
windows would not do: a second of scans at 14 Hz, whose echoes are found again, is answered with
more certainty than the network was trained to show, seven keyframes at 2 Hz are not. So its
logarithm is linear in how many scans there are and in that of their spacing (a small case of Tomani
et al., "Parameterized temperature scaling for boosting the expressive power in post-hoc uncertainty
calibration", ECCV 2022): four numbers, under which the true levels of samples in no training are
most likely.

These samples are degraded by ``snr``, for which the level is defined. Of other kinds it can hardly
be known, so that a certain answer would be wrong: where dense scans look like one of those, the
temperature rises.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dbc.errors import MissingExtra
from models.estimate.level import RADAR_KINDS
from models.estimate.radar_window import FOLLOWS, INPUTS, extent
from models.training.radar_scans import SIMULATED, Samples

try:
    import torch
    from torch.nn import functional
except ImportError:
    raise MissingExtra("train", "murk train radar") from None

if TYPE_CHECKING:
    from torch import Tensor

    from models.training.radar import RadarNet

_WITH_LEVEL = ("clean", "snr", "jitter")
_CLEAN_OR_SNR = [RADAR_KINDS.index(kind) for kind in ("clean", "snr")]
_DOUBT_FROM, _DOUBT = 0.6, 6.0
"""Probability of the other kinds from which on the temperature rises, and how fast its logarithm
does: of simulated seconds in no training, clean ones stay at 0.2 points."""
_PRIOR = 1e-3
"""Weight of a temperature of 1."""
_MOST_STEPS = 100


class Temperature(torch.nn.Module):
    """The temperature of a window; 1 until ``temper`` sets it, but for the doubt of kinds."""

    without_level: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.of_extent = torch.nn.Linear(INPUTS - FOLLOWS, 1)
        torch.nn.init.zeros_(self.of_extent.weight)
        torch.nn.init.zeros_(self.of_extent.bias)
        without_level = [[float(kind not in _WITH_LEVEL)] for kind in RADAR_KINDS]
        self.register_buffer("without_level", torch.tensor(without_level))

    def forward(self, extents: Tensor, kind: Tensor) -> Tensor:
        """Return the temperature, (n, 1).

        Parameters
        ----------
        extents:
            How many scans of what spacing, (n, 3); see ``models.estimate.radar_window.extent``.
        kind:
            Logits of the kind, (n, kinds).
        """
        other = kind.softmax(dim=1) @ self.without_level
        dense = (-extents[:, 2:]).relu()
        doubt = _DOUBT * (other - _DOUBT_FROM).relu() * dense
        return (self.of_extent(extents) + doubt).exp()

    def of(self, scans: int, spacing_s: float) -> float:
        """Return that of so many scans, so many seconds apart, without doubt of their kind."""
        own = torch.tensor(extent(round((scans - 1) * spacing_s * 1e9), scans))
        with torch.no_grad():
            return float(self.of_extent(own).exp())


def temper(network: RadarNet, folds: Mapping[int, RadarNet], held_out: Samples) -> None:
    """Set the temperature of a network to what suits samples in no training.

    Parameters
    ----------
    network:
        Changed in place; it answers the simulated samples.
    folds:
        By drive, the network trained without it, which answers the recorded samples of that drive.
    held_out:
        Of the same recorded drives, and of simulated ones that no training had.
    """
    known = held_out.among(np.isin(held_out.kinds, _CLEAN_OR_SNR))
    drives = known.drives[:, 0]
    groups = [(network, known.among(drives == SIMULATED))]
    groups += [(fold, known.among(drives == index)) for index, fold in folds.items()]
    with torch.no_grad():
        logits = torch.cat([one.untempered(torch.from_numpy(own.inputs))[0] for one, own in groups])
    levels = torch.cat([torch.from_numpy(own.levels) for _, own in groups])
    extents = torch.cat([torch.from_numpy(own.inputs[:, FOLLOWS:]) for _, own in groups])
    layer = network.temperature.of_extent
    optimizer = torch.optim.LBFGS(
        layer.parameters(), max_iter=_MOST_STEPS, line_search_fn="strong_wolfe"
    )

    def loss() -> Tensor:
        optimizer.zero_grad()
        surprise = functional.cross_entropy(logits / layer(extents).exp(), levels)
        total = surprise + _PRIOR * sum(one.square().sum() for one in layer.parameters())
        total.backward()  # type: ignore[no-untyped-call]
        return total

    optimizer.step(loss)  # type: ignore[no-untyped-call]
