"""The picture of a run: injected against estimated level over time, a panel a sensor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from numpy.typing import NDArray

from dbc.errors import InputError
from models.estimate.level import NoiseLevel

ESTIMATE_COLOUR = "#0b6e99"
TRUTH_COLOUR = "#c2410c"


def draw_levels(levels: Sequence[NoiseLevel], path: Path) -> None:
    """Draw the levels of a run over time, with a band of one standard deviation.

    Parameters
    ----------
    levels:
        Noise levels of one or more sensors.
    path:
        The PNG file to write.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    sensors = sorted({level.sensor for level in levels})
    figure, axes = plt.subplots(
        max(1, len(sensors)), 1, figsize=(10, 3.2 * max(1, len(sensors))), squeeze=False
    )
    for axis, sensor in zip(axes[:, 0], sensors, strict=False):
        _panel(axis, sensor, [level for level in levels if level.sensor == sensor])
    axes[-1, 0].set_xlabel("time, s")
    figure.tight_layout()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=120)
    except OSError as error:
        raise InputError(path, error.strerror or "cannot be written", "give another file") from None
    finally:
        plt.close(figure)


def _panel(axis: Axes, sensor: str, levels: Sequence[NoiseLevel]) -> None:
    stamps = np.array([level.stamp_ns for level in levels])
    t = (stamps - stamps[0]) * 1e-9
    truth = np.array([level.true_level for level in levels])
    estimate = np.array([level.level for level in levels])
    std = np.array([level.std for level in levels])
    low, high = np.clip(estimate - std, 0, 100), np.clip(estimate + std, 0, 100)
    axis.fill_between(t, low, high, color=ESTIMATE_COLOUR, alpha=0.2, linewidth=0)
    axis.plot(t, truth, color=TRUTH_COLOUR, drawstyle="steps-post", label="injected")
    axis.plot(t, estimate, color=ESTIMATE_COLOUR, label="estimated, ± 1 standard deviation")
    _name_kinds(axis, t, levels)
    axis.set_title(sensor, loc="left")
    axis.set_ylabel("noise level, %")
    axis.set_ylim(-3, 112)
    axis.legend(loc="lower right", bbox_to_anchor=(1, 1), frameon=False, ncols=2)
    axis.spines[["top", "right"]].set_visible(False)


def _name_kinds(axis: Axes, t: NDArray[np.float64], levels: Sequence[NoiseLevel]) -> None:
    """Write each injected kind where it begins."""
    before: tuple[str, ...] = ()
    for time, level in zip(t, levels, strict=True):
        kinds = tuple(level.injected or ())
        if kinds and kinds != before:
            axis.text(time, level.true_level + 2, ", ".join(kinds), color=TRUTH_COLOUR, size=9)
        before = kinds
