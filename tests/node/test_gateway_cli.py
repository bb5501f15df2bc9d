from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

MURK = [sys.executable, "-c", "from node.cli import main; main()", "gateway"]


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


def murk(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*MURK, *arguments], capture_output=True, text=True, timeout=60)


def test_a_gateway_runs_until_it_is_told_to_end_and_obeys_meanwhile() -> None:
    command = [*MURK, "virtual:a", "virtual:b", "--sensor", "front", "--json"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        started = json.loads(process.stdout.readline())
        assert started["type"] == "started"
        assert (started["sensor"], started["input"]) == ("front", "virtual:a")
        done = murk("set", "front", "drop", "5")
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
        refused = murk("set", "radar", "snr", "60")
        assert refused.returncode == 2
        assert refused.stderr == "murk: radar: has no running gateway; running: front\n"
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    (summary,) = map(json.loads, rest.splitlines())
    assert summary["type"] == "summary"
    assert summary["frames_in"] == 0


def write_image(path: Path) -> None:
    assert cv2.imwrite(str(path), np.full((48, 64, 3), 90, np.uint8))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["can_x", "virtual:b"], "can_x: "),
        (["virtual:a"], "virtual:a: is not IN OUT [SCENE]"),
        (["virtual:a", "virtual:a"], "virtual:a: is input and output"),
        (["virtual:a", "virtual:b", "missing.toml"], "missing.toml: "),
        (["missing.mp4", "out.mp4"], "missing.mp4: "),
        (["grey.png", "out.mp4", "--both-ways"], "--both-ways: is for CAN"),
        (["grey.png", "-", "--json"], "--json: standard output carries the frames"),
        (["grey.png", "/dev/null"], "/dev/null: is not a V4L2 device"),
        (["set", "radar", "snr"], "set radar snr: is no command"),
        (["set", "radar", "snr", "much"], "set radar snr much: is no command"),
        (["set", "radar", "snr", "60"], "radar: has no running gateway; none is running"),
    ],
)
def test_what_is_wrong_is_one_line(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from node import cli

    monkeypatch.chdir(tmp_path)
    write_image(tmp_path / "grey.png")
    monkeypatch.setattr("sys.argv", ["murk", "gateway", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith(f"murk: {message}")
    assert len(told.err.splitlines()) == 1
    assert not (tmp_path / "out.mp4").exists()


def test_standard_output_carries_nothing_but_raw_frames(tmp_path: Path) -> None:
    write_image(tmp_path / "grey.png")
    command = [*MURK, str(tmp_path / "grey.png"), "-", "--fault", "black:100"]
    result = subprocess.run(command, capture_output=True, timeout=60, check=True)
    assert result.stdout == bytes(64 * 48 * 3)
    assert "frames out" in result.stderr.decode()
