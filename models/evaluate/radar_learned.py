"""Shows what one recorded scan tells by how many drives were learned from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from models.evaluate.radar_left_out import Learned
from models.evaluate.report import Picture, Result, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ERROR = "mean error, points"
_TITLE = "Radar: one recorded scan by how many drives were learned from"


def learned_results(rows: Sequence[Learned], right: float, error: float) -> Iterator[Result]:
    """Yield the table, what a doubling of the drives brings, and the plot.

    Parameters
    ----------
    right, error:
        The goals: %, points.
    """
    yield Table(
        _TITLE,
        (
            *("learned from simulated drives and", "right, %", "± by choice"),
            *(_ERROR, "± by choice", "drives that move", "drives that stand"),
        ),
        tuple(
            (
                learned_from(each),
                100 * each.reached[0],
                100 * each.spread[0],
                each.reached[1],
                each.spread[1],
                *(
                    f"{100 * right:.1f} % / {error:.1f}"
                    for right, error in (each.moving, each.standing)
                ),
            )
            for each in rows
        ),
    )
    yield _doublings([each for each in rows if each.others and not each.other_half], right, error)
    yield _picture(rows, right, error)


def _doublings(rows: Sequence[Learned], right: float, error: float) -> Table:
    """Return how far off the goals are by a straight line over the logarithm of the drives."""
    doublings = np.log2([each.others for each in rows])
    cells: list[tuple[str | float, ...]] = []
    for place, name, scale, goal in ((0, "right, %", 100.0, right), (1, _ERROR, 1.0, error)):
        reached = scale * np.array([each.reached[place] for each in rows])
        slope, start = np.polynomial.Polynomial.fit(doublings, reached, 1).convert().coef[::-1]
        missing = (goal - start) / slope if slope else np.inf
        cells.append((name, float(slope), float(reached[-1]), goal, float(missing)))
    columns = ("one recorded scan", "a doubling of the drives brings", "with all", "goal")
    return Table(
        "Radar: how many drives the goals of one scan would take, if it goes on like that",
        (*columns, "doublings of one drive to the goal"),
        tuple(cells),
    )


def learned_from(each: Learned) -> str:
    """Return which drives were learned from, in words."""
    name = f"{each.others} other recorded drives" if each.others != 1 else "1 other recorded drive"
    return f"{name} and the other half of the same" if each.other_half else name


def _picture(rows: Sequence[Learned], right: float, error: float) -> Picture:
    def draw(figure: Figure) -> None:
        curve = [each for each in rows if not each.other_half]
        for place, axis, label, scale, goal in zip(
            (0, 1),
            figure.subplots(1, 2),
            ("right, %", _ERROR),
            (100.0, 1.0),
            (right, error),
            strict=True,
        ):
            others = [each.others for each in curve]
            for name, part in (("drives that move", "moving"), ("that stand", "standing")):
                values = [scale * getattr(each, part)[place] for each in curve]
                axis.plot(others, values, marker=".", linewidth=1, label=name)
            axis.errorbar(
                others,
                [scale * each.reached[place] for each in curve],
                [scale * each.spread[place] for each in curve],
                color="k",
                marker="o",
                capsize=3,
                label="all left out",
            )
            for each in rows:
                if each.other_half:
                    height = scale * each.reached[place]
                    axis.plot(each.others, height, "r*", markersize=11, label="own other half too")
            axis.axhline(goal, color="0.6", linestyle=":", label="goal")
            axis.set_ylim(bottom=0)
            axis.set_xlabel("other recorded drives learned from")
            axis.set_ylabel(label)
            axis.spines[["top", "right"]].set_visible(False)
        figure.axes[0].legend(frameon=False, fontsize=8)

    return Picture(_TITLE, draw)
