from __future__ import annotations

from pathlib import Path

from models.evaluate.report import Goal, Point
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
