from __future__ import annotations

import json
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from node.cli.doctor import EXTRAS, REQUIRED

MURK = [sys.executable, "-c", "from node.cli import main; main()"]


def murk(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*MURK, *arguments], capture_output=True, text=True, timeout=120, cwd=cwd)


def records(result: subprocess.CompletedProcess[str]) -> list[dict[str, Any]]:
    assert result.returncode == 0, result.stderr
    return [json.loads(line) for line in result.stdout.splitlines()]


def one_line(result: subprocess.CompletedProcess[str]) -> str:
    assert result.returncode == 2, result.stderr
    assert result.stdout == ""
    assert len(result.stderr.splitlines()) == 1, result.stderr
    return result.stderr


def test_run_prints_levels_then_a_summary() -> None:
    flags = ["--camera", "world", "--radar", "world", "--fast", "--duration", "1", "--json"]
    *levels, summary = records(murk("run", *flags, "--inject", "camera:noise:60"))
    assert summary["type"] == "summary"
    assert {level["sensor"] for level in levels} == {"camera", "radar"}
    for level in levels:
        assert level["type"] == "noise_level"
        assert 0 <= level["level"] <= 100
        assert level["std"] >= 0
        assert len(level["probabilities"]) == 11
        expected = {"noise": 60.0} if level["sensor"] == "camera" else None
        assert level["injected"] == expected
        assert {"stamp_ns", "kind", "raw", "latency_ns", "sequence", "dropped"} < set(level)


def test_a_radar_run_loads_no_video_library_and_builds_no_injector() -> None:
    script = (
        "import sys; from node.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "wanted = ('cv2', 'av', 'matplotlib', 'torch', 'node.cli.live', 'models.degrade.radar')\n"
        "sys.stderr.write(' '.join(name for name in wanted if name in sys.modules))"
    )
    flags = ["run", "--radar", "world", "--fast", "--duration", "1", "--json"]
    done = subprocess.run(
        [sys.executable, "-c", script, *flags], capture_output=True, text=True, timeout=120
    )
    assert '"summary"' in done.stdout
    assert done.stderr == ""


def test_plan_says_what_is_left_out() -> None:
    stages = records(murk("plan", "--radar", "world", "--json"))
    left_out = {(stage["name"], stage["sensor"]) for stage in stages if not stage["kept"]}
    assert {("inject", "radar"), ("camera", None), ("picture", None)} <= left_out
    assert all(stage["reason"] for stage in stages)


def test_demo_ends_in_a_summary_and_a_picture(tmp_path: Path) -> None:
    picture = tmp_path / "demo.png"
    *_, summary = records(
        murk("demo", "--fast", "--json", "--duration", "2", "--picture", str(picture))
    )
    assert summary["picture"] == str(picture)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_doctor_finds_the_models_and_the_database() -> None:
    findings = records(murk("doctor", "--json"))
    assert {
        ("model", "camera", True),
        ("model", "radar", True),
        ("database", "ars408.dbc", True),
    } <= {(finding["area"], finding["name"], finding["ok"]) for finding in findings}


def test_a_name_in_brackets_is_shown_as_it_is(tmp_path: Path) -> None:
    image = tmp_path / "a[red].png"
    cv2.imwrite(str(image), np.zeros((64, 64, 3), np.uint8))
    shown = murk("estimate", image.name, cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert "a[red].png" in shown.stdout


def test_an_interrupted_run_ends_with_its_summary() -> None:
    command = [*MURK, "run", "--camera", "world", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        *_, last = process.stdout.read().splitlines()
        assert process.wait(30) == 0
    assert json.loads(last)["type"] == "summary"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run"], "no sensor"),
        (["run", "absent.toml"], "absent.toml"),
        (["run", "--camera", "absent.mp4"], "absent.mp4"),
        (["run", "--radar", "absent.log"], "absent.log"),
        (["run", "--camera", "world", "--inject", "camera:snr:3"], "snr"),
        (["run", "--camera", "world", "--inject", "camera:noise:300"], "level"),
        (["run", "--camera", "world", "--speed", "-1"], "speed"),
        (["plan", "--radar", "x.log", "--inject", "camera:noise:3"], "camera"),
        (["bench", "nothing"], "nothing"),
        (["estimate", "absent.png"], "absent.png"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(arguments: list[str], expected: str) -> None:
    assert expected in one_line(murk(*arguments))


def test_the_doctor_looks_at_every_library_that_murk_declares() -> None:
    declared = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]

    def names(requirements: list[str]) -> set[str]:
        return {requirement.partition(">=")[0] for requirement in requirements}

    assert set(REQUIRED) == names(declared["dependencies"])
    extras = {name: names(wanted) for name, wanted in declared["optional-dependencies"].items()}
    assert {name: set(wanted) for name, wanted in EXTRAS.items()} == {
        name: wanted for name, wanted in extras.items() if name != "dev"
    }


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_behind_standard_output_is_one_line() -> None:
    command = [sys.executable, "-c", "from node.cli import main; main()", "doctor", "--json"]
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert result.returncode == 1
    assert len(result.stderr.splitlines()) == 1
    assert "No space left" in result.stderr
