from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from node.cli.live import LiveView
from node.events import ModelChoice

MURK = [sys.executable, "-c", "from node.cli import main; main()"]

SCENE = """
seed = 3
duration_s = 8.0

[clock]
{clock}

[[sensors]]
name = "camera"
type = "camera"
source = "world"

[[sensors]]
name = "radar"
type = "radar"
source = "world"

[[injections]]
sensor = "camera"
kind = "noise"
points = [[1, 80], [2, 0], [4, 80], [4.4, 0]]

[[switches]]
name = "detector"
default = "camera_first"
dwell_s = 2.0
rules = [
    {{ sensor = "camera", stale_s = 60.0, model = "radar_only" }},
    {{ sensor = "camera", above = 40, hysteresis = 20, model = "radar_only" }},
]
"""


def run(folder: Path, clock: str) -> list[dict[str, Any]]:
    scene = folder / "scene.toml"
    scene.write_text(SCENE.format(clock=clock))
    done = subprocess.run(
        [*MURK, "run", "--json", str(scene)], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.fixture(scope="module")
def fast(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    return run(tmp_path_factory.mktemp("fast"), "fast = true")


def test_a_run_chooses_by_what_it_estimates_and_keeps_the_dwell(fast: list[dict[str, Any]]) -> None:
    choices = [record for record in fast if record["type"] == "model_choice"]
    start_ns = choices[0]["stamp_ns"]
    at_s = [(choice["stamp_ns"] - start_ns) * 1e-9 for choice in choices]
    models = [choice["model"] for choice in choices]
    assert models[:3] == ["camera_first", "radar_only", "camera_first"]
    assert 1.0 <= at_s[1] < 1.5
    assert all(later - before >= 2.0 for before, later in pairwise(at_s[1:]))
    assert "camera at" in choices[1]["reason"]
    assert choices[1]["previous"] == "camera_first"


def test_its_summary_tells_of_the_switch(fast: list[dict[str, Any]]) -> None:
    counts = fast[-1]["outputs"]["switch"]
    levels = [record for record in fast if record["type"] == "noise_level"]
    choices = [record for record in fast if record["type"] == "model_choice"]
    assert counts["levels"] == sum(level["sensor"] == "camera" for level in levels)
    assert counts["dropped"] == 0
    last = choices[-1]["model"]
    assert counts["switches"] == {"detector": {"choices": len(choices), "model": last}}


def test_it_chooses_alike_every_time(fast: list[dict[str, Any]], tmp_path: Path) -> None:
    def choices(records: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return [record for record in records if record["type"] == "model_choice"]

    assert choices(run(tmp_path, "fast = true")) == choices(fast)


def test_the_terminal_shows_the_active_model(capsys: pytest.CaptureFixture[str]) -> None:
    with LiveView() as view:
        view.choose(ModelChoice("detector", 0, "radar_only", "camera_first", "camera at 63 %"))
    assert capsys.readouterr().out == "detector: radar_only  (camera at 63 %)\n"
