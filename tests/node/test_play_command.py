"""``murk play`` as people and scripts call it."""

from __future__ import annotations

import itertools
import json
import os
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.can_bus import open_bus
from node import cli
from tests.node.candump_logs import START_NS, frames_at, write

_numbers = itertools.count()


@pytest.fixture(autouse=True)
def signals() -> Iterator[None]:
    """Leave the signal handlers as they were: the command sets its own."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def murk(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["murk", *arguments])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


def test_the_command_plays_and_sums_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    one = write(tmp_path / "one.log", frames_at([START_NS + k * 1_000_000 for k in range(10)]))
    two = write(
        tmp_path / "two.log", frames_at([START_NS + k * 1_000_000 for k in range(10)], [2] * 10)
    )
    spec = f"virtual:command{next(_numbers)}"
    with open_bus(spec) as bus:
        arguments = ["--speed", "10", "--id", "0x701", "--id", "2", "--json"]
        assert murk(monkeypatch, "play", str(one), str(two), spec, *arguments) == 0
        assert len(bus.read(0.0)) == 20
    (line,) = capsys.readouterr().out.splitlines()
    summary = json.loads(line)
    assert summary["type"] == "summary"
    assert summary["frames"] == 20
    assert summary["laps"] == 1


def test_the_command_without_json_speaks_to_people(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write(tmp_path / "one.log", frames_at([START_NS + k * 1_000_000 for k in range(10)]))
    assert murk(monkeypatch, "play", str(log), f"virtual:people{next(_numbers)}") == 0
    assert "10 frames" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [
        ["missing.log", "virtual:x"],
        ["one.log", "nonsense:x"],
        ["one.log", "virtual:x", "--id", "zz"],
        ["one.log", "virtual:x", "--speed", "0"],
        ["one.log", "virtual:x", "--end", "-1"],
        ["one.log"],
    ],
)
def test_wrong_usage_ends_with_two_and_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
) -> None:
    write(tmp_path / "one.log", frames_at([START_NS]))
    monkeypatch.chdir(tmp_path)
    assert murk(monkeypatch, "play", *arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "Traceback" not in captured.err


def test_a_signal_ends_a_loop_with_a_summary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write(tmp_path / "one.log", frames_at([START_NS + k * 1_000_000 for k in range(10)]))
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    try:
        assert murk(monkeypatch, "play", str(log), "virtual:signal", "--loop", "--json") == 0
    finally:
        timer.cancel()
    summary = json.loads(capsys.readouterr().out)
    assert summary["laps"] > 1
    assert summary["frames"] > 10
