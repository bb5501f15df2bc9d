"""What murk's networks are compared with: figures of opponents, in small files.

``murk train SENSOR --opponent NAME`` trains an opponent, measures it on the frames or scans that
the network is measured on, and writes such a file; ``murk bench estimate`` shows those beside the
networks' weights.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from models.estimate.network import WEIGHTS
from models.evaluate.report import Point

OPPONENTS = WEIGHTS / "opponents"

CAMERA_PAPER_ACCURACY = 0.6219
"""What the paper reports of its camera network, kinds pooled, on data and splits of its own."""


@dataclass(frozen=True, slots=True)
class Opponent:
    """An opponent, trained and measured.

    Attributes
    ----------
    name, what:
        Its name, and what it is, with all that was reduced.
    inputs:
        What it reads of a frame or scan; with its version where that is murk's own reading, which
        may have changed since.
    samples, parameters:
        Of its training; parameters are 0 where it has none to count.
    run_time_us, shipped_run_time_us:
        Run time of one estimate, everything included, and that of murk's network measured beside
        it on the same machine, one thread, microseconds.
    tables:
        By split, or by what of a radar it was measured on: by kind (``all`` first): ``count``,
        ``accuracy``, ``mean_error`` and so on.
    """

    name: str
    what: str
    inputs: str
    samples: int
    parameters: int
    run_time_us: float
    shipped_run_time_us: float
    tables: dict[str, dict[str, dict[str, float]]]

    def write(self, path: Path) -> None:
        """Write it as a JSON file."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")


def read_opponents(sensor: str) -> list[Opponent]:
    """Return the opponents of a sensor's network that ship with murk, by file name."""
    return [
        Opponent(**json.loads(path.read_text(encoding="utf-8")))
        for path in sorted(OPPONENTS.glob(f"{sensor}_*.json"))
    ]


def opponent_points(
    sensor: str, shipped_run_time_us: float, unit: str, splits: Sequence[str] = ("test",)
) -> Iterator[Point]:
    """Yield error against run time of every opponent that ships; a curve for a common first word.

    Parameters
    ----------
    shipped_run_time_us:
        What the shipped network takes now. The opponents' run times are those of then, times this
        over what it took beside them then.
    splits:
        Where it was measured; of several the first that an opponent has.
    """
    for opponent in sorted(read_opponents(sensor), key=lambda one: one.parameters):
        curve, _, knob = opponent.name.partition("_")
        run_time_us = opponent.run_time_us * shipped_run_time_us / opponent.shipped_run_time_us
        split = next(split for split in splits if split in opponent.tables)
        error = opponent.tables[split]["all"]["mean_error"]
        knob = knob.replace("_", " ") or "as it is"
        yield Point(f"opponent {curve}", knob, run_time_us, error, unit)
