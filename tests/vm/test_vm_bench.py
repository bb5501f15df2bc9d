"""``murk bench bus`` on real SocketCAN; its lines are shown."""

from __future__ import annotations

import json
import sys

import pytest

from node import cli
from tests.vm.marks import needs_machine

pytestmark = needs_machine


def test_the_benchmark_runs_on_real_buses(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["murk", "bench", "bus", "--quick", "--json"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    text = capsys.readouterr().out
    with capsys.disabled():
        sys.stdout.write(f"\n{text}")
    lines = [json.loads(line) for line in text.splitlines()]
    goals = [line for line in lines if line["type"] == "goal"]
    assert goals
    assert all("(SocketCAN)" in goal["name"] for goal in goals)
    lost = [line for line in lines if line["type"] == "point"]
    assert [line for line in lost if line["error"] != 0] == []
