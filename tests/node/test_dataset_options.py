from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.node.datasets import murk, one_line


def labels(output: Path) -> dict[str, dict[str, object]]:
    """Return the drawn parameters of each kind's first file."""
    rows = map(json.loads, (output / "labels.jsonl").read_text().splitlines())
    return {row["kind"]: row["drawn"] for row in reversed(list(rows))}


def test_the_users_parameters_reach_the_kinds_that_take_them(small: Path, tmp_path: Path) -> None:
    result = murk(
        small, tmp_path / "out", "--level=50",
        *("--kind=snr", "--kind=blur", "--kind=noise", "--kind=fog", "--kind=multipath"),
        *("--with=snr_drop_db=20", "--with=quality=consistent", "--with=method=published"),
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    drawn = labels(tmp_path / "out")
    assert (drawn["snr"]["drop_db"], drawn["snr"]["quality"]) == (10.0, "consistent")
    assert (drawn["blur"]["method"], drawn["blur"]["sigma"]) == ("published", 10.0)
    assert drawn["noise"]["std"] == 0.5
    again = murk(small, tmp_path / "out", "--level=50", "--kind=snr")
    assert "holds a run with" in one_line(again)


@pytest.mark.parametrize(
    ("kind", "option", "expected"),
    [
        ("snr", "snr_drop=20", "unknown"),
        ("snr", "std_max=20", "has no effect"),
        ("snr", "quality=good", "frozen or consistent"),
        ("snr", "snr_drop_db=much", "a value of its type"),
        ("snr", "snr_drop_db=nan", "0 to 300"),
        ("snr", "ghost_life=1.5", "whole number"),
        ("over", "method=published", "no published variant"),
        ("snr", "snr_drop_db", "a value of its type"),
    ],
)
def test_a_parameter_that_cannot_be_is_refused(
    small: Path, tmp_path: Path, kind: str, option: str, expected: str
) -> None:
    result = murk(small, tmp_path / "out", f"--kind={kind}", "--level=50", f"--with={option}")
    assert expected in one_line(result)
    assert not (tmp_path / "out").exists()
