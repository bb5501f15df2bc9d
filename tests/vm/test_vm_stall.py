"""A whole ``murk run`` that the system stops for two seconds while its radar sends."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.ars408 import sensor_can_ids
from drivers.can_bus import CanBus, open_bus
from drivers.candump import write_candump
from models.world.radar import WorldRadar
from models.world.road import World
from tests.vm.marks import needs_machine

pytestmark = needs_machine

PATIENCE_S = 120.0
STALL_S = 2.0
CYCLES = 40
FLOOD = 60_000
"""Frames of the radar's, more than the receive buffer holds."""


class MurkRun:
    """``murk run --radar vcan0 --json`` in a process of its own."""

    def __init__(self, output: Path) -> None:
        self._output = output
        command = [sys.executable, "-c", "from node.cli import main; main()", "run"]
        with output.open("wb") as file:
            self._process = subprocess.Popen([*command, "--radar", "vcan0", "--json"], stdout=file)

    def said(self, kind: str) -> list[dict[str, Any]]:
        """Return the whole lines of a type that it has written so far."""
        lines = self._output.read_text().splitlines(keepends=True)
        records = [json.loads(line) for line in lines if line.endswith("\n")]
        return [record for record in records if record["type"] == kind]

    def states(self) -> list[str]:
        return [record["state"] for record in self.said("event")]

    def scans(self) -> int:
        """Return how many scans had come when the last level was said."""
        levels = self.said("noise_level")
        return int(levels[-1]["sequence"]) + 1 if levels else 0

    def stall(self) -> None:
        self._process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        self._process.send_signal(signal.SIGCONT)

    def end(self) -> dict[str, Any]:
        """Interrupt it; return the counts of its summary."""
        self._process.send_signal(signal.SIGINT)
        assert self._process.wait(PATIENCE_S) == 0
        (summary,) = self.said("summary")
        counts: dict[str, Any] = summary["sensors"]["radar"]
        return counts

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()


@pytest.fixture
def run(tmp_path: Path) -> Iterator[MurkRun]:
    run = MurkRun(tmp_path / "said.jsonl")
    yield run
    run.kill()


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Some seconds of the simulated radar as a candump log."""
    path = tmp_path / "radar.log"
    radar = WorldRadar(World(seed=3, duration_s=CYCLES * 0.072))
    microseconds = (
        replace(frames, stamp_ns=frames.stamp_ns // 1000 * 1000) for frames in radar.frames()
    )
    write_candump(path, microseconds)
    return path


def wait_until(condition: Callable[[], bool]) -> None:
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.1)


def scans_in(log: Path) -> int:
    return sum(" 600#" in line for line in log.read_text().splitlines())


def received_by(bus: CanBus) -> int:
    """Return how many frames wait on a bus."""
    count = 0
    while frames := bus.read(0.2):
        count += len(frames)
    return count


def test_a_run_that_stalls_for_two_seconds_counts_what_it_lost(run: MurkRun, log: Path) -> None:
    play = ["canplayer", "-I", str(log), "vcan0=can0"]
    wait_until(lambda: run.states() == ["never_seen"])

    with subprocess.Popen(play) as player:  # at the radar's rate the buffer holds all of it
        wait_until(lambda: len(run.said("noise_level")) > 3 or player.poll() is not None)
        run.stall()
        time.sleep(STALL_S)
        run.go_on()
    assert player.returncode == 0
    wait_until(lambda: run.scans() == scans_in(log))

    with open_bus("vcan0", ids=sensor_can_ids(0)) as other:  # a flood is more than that
        run.stall()
        began = time.monotonic()
        flood = ["cangen", "vcan0", "-I", "701", "-L", "8", "-g", "0", "-n", str(FLOOD)]
        subprocess.run(flood, check=True)
        time.sleep(max(0.0, STALL_S - (time.monotonic() - began)))
        lost = FLOOD - received_by(other)
    assert lost > 0
    run.go_on()
    time.sleep(1.0)
    subprocess.run(play, check=True)
    wait_until(lambda: run.scans() == 2 * scans_in(log))

    counts = run.end()
    assert counts["dropped_by_source"] == lost
    assert counts["received"] == 2 * scans_in(log)
    assert counts["estimated"] + counts["dropped_by_queue"] == counts["received"]
    assert counts["frames_lost"] == counts["cycles_lost"] == counts["failures"] == 0
    back = [event["detail"] for event in run.said("event") if event["state"] == "ok"]
    assert any(float(detail.split()[2]) >= STALL_S for detail in back[1:]), back
