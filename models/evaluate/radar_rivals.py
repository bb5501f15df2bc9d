"""The radar's network beside its opponents: error against run time, and in figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from models.evaluate.opponents import opponent_points, read_opponents
from models.evaluate.radar import Answers
from models.evaluate.radar_left_out import LeftOut
from models.evaluate.radar_trial import SECOND
from models.evaluate.report import Point, Table

UNIT = "points of level, radar"
RECORDED_UNIT = "points of level, radar, recorded drives left out"

PAPER_ACCURACY = 0.2079
"""What the paper reports of its radar network, on data and splits of its own."""

_PLACES = ("recorded_scan", "recorded_seven_scans", "simulated_scan", "simulated_second")


def rival_points(
    answers: Mapping[int, Answers], run_times_us: Mapping[int, float], left_out: LeftOut
) -> Iterator[Point]:
    """Yield error against run time of the network and its opponents.

    On simulated drives by the length of the window, and on recorded ones left out of the training,
    where a window is of seven scans.

    Parameters
    ----------
    answers, run_times_us:
        Of the shipped network, by the number of scans in its window.
    """
    whole_us = run_times_us[SECOND]
    for count, own in answers.items():
        knob, error = f"window={count}", own.figures()["mean_error"]
        yield Point("radar network", knob, run_times_us[count], error, UNIT, count == SECOND)
    yield from opponent_points("radar", whole_us, UNIT, ("simulated_second", "simulated_scan"))
    scan, window = left_out.scan.mean_error, left_out.window.mean_error
    yield Point("radar network", "one scan", run_times_us[1], scan, RECORDED_UNIT)
    yield Point("radar network", "seven scans", whole_us, window, RECORDED_UNIT, shipped=True)
    places = ("recorded_seven_scans", "recorded_scan")
    yield from opponent_points("radar", whole_us, RECORDED_UNIT, places)


def opponents_table(answers: Mapping[int, Answers], left_out: LeftOut) -> Table:
    """Return accuracy and error of the opponents beside the network's.

    Parameters
    ----------
    answers:
        Of the shipped network to one simulated scan and to a second of them.
    """
    rows: list[tuple[str | float, ...]] = []
    for one in read_opponents("radar"):
        figures = [one.tables[place]["all"] if place in one.tables else None for place in _PLACES]
        cells = [_cell(each["accuracy"], each["mean_error"]) if each else "–" for each in figures]
        what = f"{one.what} (reads {one.inputs})"
        rows.append((one.name, what, one.samples, one.parameters or "–", *cells))
    reported = ("paper, as it reports", "on data and splits of its own", "–", "–")
    rows.append((*reported, f"{100 * PAPER_ACCURACY:.1f} %", "–", "–", "–"))
    recorded = [(one.accuracy, one.mean_error) for one in (left_out.scan, left_out.window)]
    simulated = [
        (figures["accuracy"], figures["mean_error"])
        for figures in (answers[count].figures() for count in (1, SECOND))
    ]
    own = [_cell(*each) for each in (*recorded, *simulated)]
    rows.append(("murk", "the shipped network", *("see its card",) * 2, *own))
    columns = (
        *("network", "what it is", "samples", "parameters"),
        *("one recorded scan, right / mean error", "seven recorded"),
        *("one simulated scan", "simulated second"),
    )
    return Table("Radar: opponents, trained on the same drives", columns, tuple(rows))


def _cell(accuracy: float, mean_error: float) -> str:
    return f"{100 * accuracy:.1f} % / {mean_error:.1f}"
