from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.node.datasets import MURK, digests, murk


def kill_workers(process: subprocess.Popen[str]) -> None:
    for pid in workers_of(process):
        os.kill(pid, signal.SIGKILL)


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [pid for pid in map(int, children) if b"spawn_main" in command_of(pid)]


def command_of(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def interrupt(command: list[str], after: int, *, workers_only: bool) -> None:
    """Start a run, and kill it (or its workers) after so many files; no worker outlives it."""
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        for _ in range(after):
            process.stdout.readline()
        workers = workers_of(process)
        if workers_only:
            kill_workers(process)
        else:
            process.kill()
        _, errors = process.communicate(timeout=60)
    if workers_only:
        assert process.returncode == 1
        assert len(errors.splitlines()) == 1
        assert "a worker process died" in errors
    deadline = time.monotonic() + 60
    while any(b"spawn_main" in command_of(pid) for pid in workers):
        assert time.monotonic() < deadline, "a worker goes on without its parent"
        time.sleep(0.05)


def check_interrupted(
    source: Path,
    folder: Path,
    arguments: list[str],
    workers_only: tuple[bool, ...],
    timeout: float = 120,
) -> None:
    """Kill a run now and then; what it leaves is always whole, and in the end the same."""
    whole, parts = folder / "whole", folder / "parts"
    result = murk(source, whole, *arguments, "--json", timeout=timeout)
    assert result.returncode == 0
    files = json.loads(result.stdout.splitlines()[-1])["files"]
    expected = digests(whole)
    shutil.rmtree(whole)
    command = [*MURK, str(source), str(parts), *arguments, "--json"]
    chance = random.Random(7)
    for only in workers_only:
        interrupt(command, chance.randint(1, files // 4), workers_only=only)
        there = digests(parts)
        finished = {name for name in there if not name.startswith(".murk/unfinished")}
        assert finished - {".murk/settings.part"} < set(expected)
        assert all(there[name] == expected[name] for name in finished)
    result = murk(source, parts, *arguments, "--json", timeout=timeout)
    summary = json.loads(result.stdout.splitlines()[-1])
    assert summary["complete"]
    assert summary["skipped"] > 0
    assert digests(parts) == expected
    shutil.rmtree(parts)


def test_killed_three_times_and_resumed_equals_uninterrupted(small: Path, tmp_path: Path) -> None:
    levels = [f"--level={level}" for level in range(0, 101, 20)]
    check_interrupted(
        small, tmp_path, ["--kind", "fog", "--kind", "snr", *levels], (False, True, False)
    )


def test_real_data_killed_and_resumed(data: Path, tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    photos = sorted((data / "camera" / "test").glob("*/*.jpg"))[:4]
    for path in [*photos, data / "radar" / "nuscenes_mini" / "scene-0061.log"]:
        (source / path.name).write_bytes(path.read_bytes())
    levels = ["--level=30", "--level=100"]
    check_interrupted(source, tmp_path, ["--kind", "noise", "--kind", "snr", *levels], (False,))


@pytest.mark.skipif("MURK_WHOLE" not in os.environ, reason="half an hour; set MURK_WHOLE to run")
@pytest.mark.parametrize("part", ["radar/nuscenes_mini", "camera/test"])
def test_all_real_data_by_all_kinds_killed_and_resumed(
    data: Path, tmp_path: Path, part: str
) -> None:
    check_interrupted(data / part, tmp_path, ["--all"], (False, False, False), timeout=7200)


def heed_ctrl_c() -> None:
    """What a shell starts in the background ignores Ctrl-C, and so would its children."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_ctrl_c_ends_with_a_summary(small: Path, tmp_path: Path) -> None:
    command = [*MURK, str(small), str(tmp_path / "out"), "--all", "--json"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=heed_ctrl_c
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=120)
    summary = json.loads(output.splitlines()[-1])
    assert process.returncode != 0
    assert "Traceback" not in errors
    assert summary["type"] == "summary"
    assert not summary["complete"]
    assert summary["left"] > 0
