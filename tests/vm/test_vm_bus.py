"""Levels on a real CAN bus: candump hears them, and cantools reads them as an ECU would."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cantools
import pytest

import dbc
from drivers.can_frames import concatenate
from drivers.candump import read_candump
from node.bus.can import CanOutput
from node.bus.can_levels import LevelReader
from node.bus.in_process import Bus
from node.events import EVENT_TOPIC
from node.plan import plan
from node.scene import check_scene
from tests.vm.marks import needs_machine

pytestmark = needs_machine

PATIENCE_S = 60.0


@pytest.fixture
def heard(tmp_path: Path) -> Iterator[Path]:
    """What candump hears on vcan0 during the test."""
    path = tmp_path / "heard.log"
    with path.open("w") as output:
        candump = subprocess.Popen(["candump", "-L", "vcan0"], stdout=output)
        time.sleep(0.5)
        yield path
        candump.terminate()
        candump.wait()


def wait_for(is_so: object) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not is_so():  # type: ignore[operator]
        assert time.monotonic() < deadline_s
        time.sleep(0.05)


def test_candump_hears_each_level_of_a_run_and_cantools_reads_it(heard: Path) -> None:
    murk = "from node.cli import main; main()"
    arguments = ["run", "--radar", "world", "--inject", "radar:snr:80", "--can", "vcan0"]
    run = subprocess.run(
        [sys.executable, "-c", murk, *arguments, "--duration", "2", "--json"],
        stdout=subprocess.PIPE,
        check=True,
    )
    records = [json.loads(line) for line in run.stdout.splitlines()]
    summary = records[-1]
    assert summary["outputs"]["can"]["failed"] == 0
    wait_for(lambda: len(heard.read_text().splitlines()) >= summary["outputs"]["can"]["sent"])
    frames = concatenate(list(read_candump(heard)))
    message = cantools.database.load_file(Path(str(dbc.__path__[0])) / "noise_level.dbc").messages[
        0
    ]
    said = [message.decode(bytes(payload)) for payload in frames.data]
    assert len(said) == summary["outputs"]["can"]["sent"]
    counters = [values["NoiseLevel_Counter"] for values in said]
    assert all((after - before) % 16 == 1 for before, after in itertools.pairwise(counters))
    last = [record for record in records if record["type"] == "noise_level"][-1]
    assert said[-1]["NoiseLevel_Level"] == pytest.approx(last["level"], abs=0.26)
    assert str(said[-1]["NoiseLevel_Kind"]) == last["kind"]
    assert str(said[-1]["NoiseLevel_State"]) == "ok"
    with LevelReader("vcan0") as reader:
        assert len(list(reader.decode(frames))) == len(frames)
        assert (reader.corrupt, reader.lost) == (0, 0)


def test_levels_go_on_when_the_interface_is_back() -> None:
    content = {
        "sensors": [{"name": "radar", "type": "radar", "source": "world"}],
        "outputs": {"can": {"bus": "vcan0"}},
    }
    with Bus() as bus, LevelReader("vcan0") as reader:
        output = CanOutput(plan(check_scene(content, "test")), bus)
        wait_for(lambda: reader.read(1.0))
        subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
        try:
            wait_for(lambda: output.counts()["failed"] > 1)
            assert "not sent" in bus.latest(EVENT_TOPIC).detail
        finally:
            subprocess.run(["ip", "link", "set", "vcan0", "up"], check=True)
        sent = output.counts()["sent"]
        wait_for(lambda: output.counts()["sent"] > sent + 2)
        output.close()
