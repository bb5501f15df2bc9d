"""The camera's network and how it learns from samples.

The loss adds to the cross entropy the squared distance of the cumulative distributions (ranked
probability score), because the levels are ordered: 50 % for 40 % is better than for 0 %.
"""

from __future__ import annotations

from math import prod
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dbc.errors import MissingExtra
from models.estimate.exposure import SEEN
from models.estimate.image_places import PLACES
from models.estimate.level import FRAME_KINDS, IMAGE_KINDS, LEVELS, OUTER_KINDS
from models.training.camera_frames import Samples

try:
    import torch

    from models.training.descend import Report, descend
    from models.training.device import best_device
except ImportError:
    raise MissingExtra("train", "murk train camera") from None

if TYPE_CHECKING:
    from torch import Tensor

HIDDEN = 156
_SEEN = 16
_BATCH = 256
_WEIGHT_DECAY = 2e-2
_RANKED_WEIGHT = 2.0
_CLEAN = FRAME_KINDS.index("clean")
_TUNNEL = FRAME_KINDS.index("tunnel")
_CLEAN_WEIGHT = 3.0  # most frames of a drive are clean: a false alarm is the costliest error
_CLEAN_LOG_ODDS = 5.0  # 150 times as often in a drive as among the samples
_OUTER_LOG_ODDS = -3.0  # a hazy or soft scene is no degradation: what it is must be sure
_TUNNEL_ALONE = -4.0  # a scene may be dark or bright by itself
_TUNNEL_IN_A_RUN = -2.0
_SHARE_ALONE = 0.5
_STANDARD_DEVIATIONS = 5.0
_NEVER = -30.0
_LEAST_LOG = -12.0


class Perceptron(torch.nn.Module):
    """Two hidden layers on one frame's standardised features.

    Before them, two small layers look at every place of the frame in the same way: at it and its
    neighbours, and at how it differs from the whole. What they see on average and at most goes to
    the others with the features.

    It answers jointly in kind and level, so that what it holds of the level goes by the kind that
    it takes the degradation for; level and kind come from summing over the other.

    Parameters
    ----------
    mean, std:
        Of the training features, (n,) each.
    hidden:
        Width of the hidden layers.
    """

    mean: Tensor
    std: Tensor
    middle: Tensor
    spread: Tensor
    height: Tensor

    def __init__(self, mean: Tensor, std: Tensor, hidden: int = HIDDEN) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("std", std)
        measures, rows, _ = PLACES
        mean_of_places, variance = (
            of[: prod(PLACES)].reshape(measures, -1) for of in (mean, std.square())
        )
        middle = mean_of_places.mean(dim=1)
        spread = (variance.mean(dim=1) + mean_of_places.var(dim=1)).sqrt()
        self.register_buffer("middle", middle.reshape(1, -1, 1, 1))
        self.register_buffer("spread", spread.reshape(1, -1, 1, 1))
        height = torch.linspace(-1, 1, rows).reshape(1, 1, -1, 1)
        self.register_buffer("height", height, persistent=False)
        self.look = torch.nn.Sequential(
            torch.nn.Conv2d(2 * measures + 1, _SEEN, kernel_size=3, padding=1),
            torch.nn.SiLU(),
            torch.nn.Conv2d(_SEEN, _SEEN, kernel_size=1),
            torch.nn.SiLU(),
        )
        self.layers = torch.nn.Sequential(
            torch.nn.Dropout(0.1),
            torch.nn.Linear(len(mean) + 2 * _SEEN, hidden),
            torch.nn.SiLU(),
            torch.nn.Dropout(0.2),
            torch.nn.Linear(hidden, hidden),
            torch.nn.SiLU(),
            torch.nn.Dropout(0.1),
            torch.nn.Linear(hidden, len(IMAGE_KINDS) * len(LEVELS)),
        )

    def joint(self, features: Tensor) -> Tensor:
        """Return logits of kind and level together, (batch, 15, 11)."""
        limit = _STANDARD_DEVIATIONS
        standard = ((features - self.mean) / self.std).clamp(-limit, limit)
        inputs = torch.cat([standard, self._seen(features)], dim=1)
        return self.layers(inputs).reshape(-1, len(IMAGE_KINDS), len(LEVELS))

    def _seen(self, features: Tensor) -> Tensor:
        """Return the mean and the most of what is seen over all places, (batch, 2 × seen)."""
        places = features[:, : prod(PLACES)].reshape(-1, *PLACES)
        places = (places - self.middle) / self.spread
        whole = places.mean(dim=(2, 3), keepdim=True)
        heights = self.height.expand(len(features), 1, *PLACES[1:])
        seen = self.look(torch.cat([places, places - whole, heights], dim=1))
        return torch.cat([seen.mean(dim=(2, 3)), seen.amax(dim=(2, 3))], dim=1)


class Successive(torch.nn.Module):
    """What one frame shows, and what those before it add: the kind that only they tell.

    To the frame's own answer, which stays as it is, a small network adds a tunnel's row. It sees
    what was before, and how probable the frame alone makes each kind and level. Before it is
    fitted, it never says a tunnel. To the logits by the samples' odds come those of a drive, for a
    frame alone and in a run; the level's are divided by ``temperature``.

    Parameters
    ----------
    image:
        The perceptron, fitted.
    """

    alone: Tensor
    in_a_run: Tensor
    temperature: Tensor

    def __init__(self, image: Perceptron) -> None:
        super().__init__()
        odds = torch.zeros(len(FRAME_KINDS), len(LEVELS))
        odds[_TUNNEL] = _NEVER
        self.register_buffer("alone", odds)
        self.register_buffer("in_a_run", odds.clone())
        self.register_buffer("temperature", torch.ones(()))
        self.image = image
        inputs = SEEN + len(IMAGE_KINDS) + len(LEVELS)
        self.tunnel = torch.nn.Sequential(
            torch.nn.Linear(inputs, 48),
            torch.nn.SiLU(),
            torch.nn.Linear(48, 32),
            torch.nn.SiLU(),
            torch.nn.Linear(32, len(LEVELS)),
        )

    def joint(self, answer: Tensor, history: Tensor) -> Tensor:
        """Return logits of kind and level together, (batch, 16, 11), by the samples' odds.

        Parameters
        ----------
        answer:
            What the perceptron's ``joint`` returns.
        history:
            (batch, 41), what ``models.estimate.exposure.seen_before`` returns.
        """
        alone = answer.flatten(1).log_softmax(dim=1).view_as(answer)
        sure = [alone.logsumexp(dim=of).clamp(min=_LEAST_LOG) / -_LEAST_LOG for of in (2, 1)]
        row = self.tunnel(torch.cat([history, *sure], dim=1))
        return torch.cat([alone, row.unsqueeze(1)], dim=1)

    def forward(self, features: Tensor, history: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits of level (batch, 11) and of kind (batch, kinds)."""
        odds = torch.where(history[:, :1, None] > 0, self.in_a_run, self.alone)
        joint = self.joint(self.image.joint(features), history) + odds
        return joint.logsumexp(dim=1) / self.temperature, joint.logsumexp(dim=2)


def favour_clean(network: Successive) -> None:
    """Turn the odds of the kinds from those of the samples to those of a drive."""
    for odds, of_tunnel in ((network.alone, _TUNNEL_ALONE), (network.in_a_run, _TUNNEL_IN_A_RUN)):
        odds.zero_()
        odds[_CLEAN, 0] = _CLEAN_LOG_ODDS
        for kind in OUTER_KINDS:
            odds[FRAME_KINDS.index(kind)] = _OUTER_LOG_ODDS
        odds[_TUNNEL] = of_tunnel


def fit(
    network: Perceptron,
    samples: Samples,
    *,
    epochs: int,
    peak_rate: float,
    report: Report,
) -> None:
    """Train a network, which ends in the state of evaluation; the rate rises and falls once.

    Parameters
    ----------
    epochs:
        A multiple of ten; after every tenth of them ``report`` gets a record of the progress.
    """
    device = best_device()
    network.to(device)
    features = torch.from_numpy(samples.features).to(device)
    levels = torch.from_numpy(_spread_over_levels(samples.levels)).to(device)
    kinds = torch.from_numpy(samples.kinds).to(device)
    network.train()
    descend(
        torch.optim.AdamW(network.parameters(), weight_decay=_WEIGHT_DECAY),
        lambda batch: _loss(network.joint(features[batch]), levels[batch], kinds[batch]),
        len(features),
        batch=_BATCH,
        epochs=epochs,
        peak_rate=peak_rate,
        report=report,
    )
    network.to("cpu").eval()


def fit_tunnel(
    network: Successive,
    samples: Samples,
    histories: NDArray[np.float32],
    *,
    epochs: int,
    peak_rate: float,
    report: Report,
) -> None:
    """Train what tells a tunnel by what was before a frame; the rest of the network stays.

    Parameters
    ----------
    histories:
        (n, draws, 41), several of each sample, of which every epoch takes one; and every second
        time none at all.
    epochs, peak_rate, report:
        As for ``fit``.
    """
    with torch.no_grad():
        features = torch.split(torch.from_numpy(samples.features), _BATCH)
        answers = torch.cat([network.image.joint(part) for part in features])
    levels = torch.from_numpy(_spread_over_levels(samples.levels))
    drawn, kinds = torch.from_numpy(histories), torch.from_numpy(samples.kinds)

    def loss_of(batch: Tensor) -> Tensor:
        history = drawn[batch, torch.randint(drawn.shape[1], batch.shape)]
        history = history.masked_fill(torch.rand(len(batch), 1) < _SHARE_ALONE, 0)
        return _loss(network.joint(answers[batch], history), levels[batch], kinds[batch])

    descend(
        torch.optim.AdamW(network.tunnel.parameters()),
        loss_of,
        len(answers),
        batch=_BATCH,
        epochs=epochs,
        peak_rate=peak_rate,
        report=report,
        name="tunnel's epoch",
    )
    network.eval()


def _spread_over_levels(levels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the distribution over the eleven levels that a level between two of them means."""
    distance = np.abs(levels[:, np.newaxis] - LEVELS) / (LEVELS[1] - LEVELS[0])
    return np.maximum(1 - distance, 0).astype(np.float32)


def _loss(joint: Tensor, levels: Tensor, kinds: Tensor) -> Tensor:
    log = joint.flatten(1).log_softmax(dim=1).view_as(joint)
    of_kind = log[torch.arange(len(kinds), device=kinds.device), kinds]
    apart = log.exp().sum(dim=1).cumsum(dim=1) - levels.cumsum(dim=1)
    losses = _RANKED_WEIGHT * apart.square().sum(dim=1) - (levels * of_kind).sum(dim=1)
    weights = torch.where(kinds == _CLEAN, _CLEAN_WEIGHT, 1.0)
    return (weights * losses).sum() / weights.sum()
