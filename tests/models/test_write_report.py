from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from models.evaluate.report import Goal, Picture, Point, Result, Table, on_front
from models.evaluate.write import write_report


def test_the_page_holds_every_point_and_goal_and_links_its_plots(tmp_path: Path) -> None:
    results = [
        Point("ours", "batch=1", 3.0, 0.0, "bits"),
        Point("ours", "level=5", 30.0, 1.5, "counts"),
        Point("theirs", "level=5", 300.0, 0.5, "counts"),
        Goal("times theirs", 10.0, 5.0),
        Goal("time, ms", 3.0, 1.0, at_least=False),
    ]
    page, *plots = write_report("things", "What it is.", results, tmp_path)
    text = page.read_text()
    assert len(plots) == 2  # units share no axis
    assert all(plot.read_bytes().startswith(b"\x89PNG") and plot.name in text for plot in plots)
    assert "| times theirs | 10 | ≥ 5 | yes |" in text
    assert "| time, ms | 3 | ≤ 1 | **no** |" in text
    assert "| theirs | level=5 | 300 | 0.5 | counts |" in text


def test_a_knob_that_costs_no_time_has_rows_but_no_plot(tmp_path: Path) -> None:
    results = [Point("ours", f"rate={rate}", 3.0, float(rate), "m") for rate in range(3)]
    page, *plots = write_report("things", "What it is.", results, tmp_path)
    assert plots == []
    assert "| ours | rate=2 | 3 | 2 | m |" in page.read_text()


def test_rivals_for_one_task_have_their_front_marked(tmp_path: Path) -> None:
    results: list[Result] = [
        Point("ours", "small", 3.0, 2.0, "m", shipped=True),
        Point("ours", "large", 9.0, 1.0, "m"),
        Point("theirs", "slow", 30.0, 1.5, "m"),
    ]
    page, _ = write_report("things", "What it is.", results, tmp_path)
    text = page.read_text()
    assert "| ours (default) | small | 3 | **2** | m |" in text
    assert "| ours | large | 9 | **1** | m |" in text
    assert "| theirs | slow | 30 | 1.5 | m |" in text


def test_tables_and_pictures_follow_in_their_order(tmp_path: Path) -> None:
    results = [
        Table("By kind", ("kind", "error"), (("blur", 1.23456), ("all", 2))),
        Picture("A line", lambda figure: figure.subplots().plot([0, 1])),
    ]
    page, plot = write_report("things", "What it is.", results, tmp_path)
    text = page.read_text()
    assert "## By kind\n\n| kind | error |\n|---|---|\n| blur | 1.235 |\n| all | 2 |" in text
    assert f"## A line\n\n![A line]({plot.name})" in text
    assert plot.read_bytes().startswith(b"\x89PNG")


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=12))
def test_the_front_holds_what_nothing_beats_and_only_that(pairs: list[tuple[int, int]]) -> None:
    points = [Point("v", "k", time, error, "m") for time, error in pairs]
    for (time, error), best in zip(pairs, on_front(points), strict=True):
        rivals = [pair for pair in pairs if pair != (time, error)]
        assert best == all(a > time or b > error for a, b in rivals)
