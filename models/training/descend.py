"""The way down that networks of perceptrons' size take: shuffled batches, and one rise and fall."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from torch import Tensor

Report = Callable[[dict[str, object]], None]


def descend(
    optimizer: torch.optim.Optimizer,
    loss_of: Callable[[Tensor], Tensor],
    samples: int,
    *,
    batch: int,
    epochs: int,
    peak_rate: float,
    report: Report = lambda _: None,
    name: str = "epoch",
) -> None:
    """Take a network through so many epochs; the rate rises and falls once.

    Parameters
    ----------
    optimizer:
        Of the parameters that are to be trained.
    loss_of:
        Returns the mean loss of some samples, by their indices (n,).
    samples, batch:
        Number of samples, and of those in a batch.
    report:
        Called after every tenth of the epochs (after each, of fewer than ten), with a record of the
        progress in which their number goes by ``name``.
    """
    steps = epochs * -(-samples // batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, peak_rate, total_steps=steps)
    for epoch in range(1, epochs + 1):
        total = 0.0
        for chosen in torch.split(torch.randperm(samples), batch):
            loss = loss_of(chosen)
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
            total += loss.item() * len(chosen)
        if epoch % max(1, epochs // 10) == 0:
            report({name: epoch, "of": epochs, "loss": total / samples})
