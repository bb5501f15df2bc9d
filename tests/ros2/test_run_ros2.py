"""``murk run --ros2``: a whole run, heard by other processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest

from tests.ros2.listening import PATIENCE_S, ListenerProcess

pytest.importorskip("cyclonedds", reason="needs the extra 'ros2'")

WORLD = ["run", "--radar", "world", "--camera", "world", "--loop", "--ros2", "--json"]
RADAR_ONLY = ["run", "--radar", "world", "--ros2"]


def murk(*arguments: str, domain: int | str, code: str = "") -> subprocess.Popen[str]:
    """Start murk; ``code`` is run in it first."""
    command = [sys.executable, "-c", f"{code}\nfrom node.cli import main\nmain()", *arguments]
    return subprocess.Popen(
        command,
        env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.fixture
def node(domain: int) -> Iterator[subprocess.Popen[str]]:
    started = murk(*WORLD, "--inject", "camera:noise:60", domain=domain)
    yield started
    started.kill()
    started.communicate()


def test_others_hear_a_run_from_its_levels_to_its_summary(
    node: subprocess.Popen[str], listen: Callable[..., ListenerProcess]
) -> None:
    radar = listen("/murk/radar/noise_level")
    assert radar.next()["header"]["frame_id"] == "radar"
    camera = listen("/murk/camera/noise_level")  # a late joiner
    noisy = camera.until(lambda level: level["level"] > 40)
    assert noisy["injected_kinds"] == ["noise"]
    assert noisy["injected_levels"] == [60.0]
    assert len(noisy["kinds"]) == len(noisy["kind_probabilities"])
    diagnostics = listen("/diagnostics", "DiagnosticArray", "volatile")
    array = diagnostics.until(lambda array: array["status"][2]["level"] in (1, 2))
    assert [status["name"].split(": ")[1] for status in array["status"]] == [
        "node",
        "radar",
        "camera",
    ]
    node.send_signal(signal.SIGINT)
    output, errors = node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 0, errors
    summary = json.loads(output.splitlines()[-1])
    counts = summary["outputs"]["ros2"]
    assert counts["sent"] > 0
    assert counts["dropped"] == counts["failed"] == counts["rivals"] == 0


def refused(process: subprocess.Popen[str]) -> str:
    """Return the one line with which a run was refused as wrong usage."""
    output, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert not output
    assert len(errors.splitlines()) == 1
    return errors


def test_a_wrong_domain_is_one_line() -> None:
    line = refused(murk(*RADAR_ONLY, domain=233))
    assert "ROS_DOMAIN_ID: '233' is no DDS domain" in line


def test_without_the_extra_it_is_one_line(domain: int) -> None:
    missing = "import sys; sys.modules['cyclonedds'] = None"
    line = refused(murk(*RADAR_ONLY, domain=domain, code=missing))
    assert "pip install 'murk[ros2]'" in line
