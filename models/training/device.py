"""Where networks are trained."""

from __future__ import annotations

from dbc.errors import MissingExtra

try:
    import torch
except ImportError:
    raise MissingExtra("train", "murk train") from None


def best_device() -> torch.device:
    """Return a GPU where PyTorch finds one, else the processor."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")
