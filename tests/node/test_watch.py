"""``murk watch``: what a carrier carries is told topic by topic, and what is no carrier refused."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from uuid import uuid4

import numpy as np
import pytest
from typer.testing import CliRunner

from dbc.errors import InputError
from models.estimate.level import NoiseLevel
from node.bus.can import CanOutput
from node.bus.in_process import Bus
from node.cli import app
from node.pipeline import Pipeline
from node.plan import Plan, plan
from node.scene import check_scene
from node.watch import Heard, TopicView, open_carrier

PATIENCE_S = 20.0
LEVEL = "/murk/front/noise_level"


def a_plan(**outputs: object) -> Plan:
    content = {
        "sensors": [{"name": "front", "type": "radar", "source": "world"}],
        "injections": [{"sensor": "front", "kind": "snr", "level": 70}],
        "outputs": outputs,
        "clock": {"fast": True},
        "duration_s": 1.0,
    }
    return plan(check_scene(content, "test"))


def a_level(stamp_ns: int = 0) -> NoiseLevel:
    return NoiseLevel(
        sensor="front",
        stamp_ns=stamp_ns,
        level=62.5,
        std=4.0,
        probabilities=np.full(11, 1 / 11),
        kind="snr",
        kind_probabilities={"clean": 0.1, "snr": 0.9},
        raw=60.0,
        injected={"snr": 60.0},
        latency_ns=1000,
        sequence=0,
        dropped=0,
    )


def wait_for(heard: Callable[[], list[Heard] | None], topic: str) -> Heard:
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        for message in heard() or ():
            if message.topic == topic:
                return message
    raise AssertionError(f"nothing came on {topic}")


def test_a_level_on_can_is_told_with_its_identifier() -> None:
    channel = f"virtual:{uuid4()}"
    with Bus() as bus, closing(open_carrier(f"can:{channel}")) as carrier:
        output = CanOutput(a_plan(can={"bus": channel}), bus)
        assert "never_seen" in wait_for(lambda: carrier.heard(0.2), "0x6F0").text
        bus.publish(LEVEL, a_level())
        deadline_s = time.monotonic() + PATIENCE_S
        while "62.5 % ± 4.0, snr" not in wait_for(lambda: carrier.heard(0.2), "0x6F0").text:
            assert time.monotonic() < deadline_s
        output.close()


def test_a_late_watcher_on_dds_gets_the_last_level() -> None:
    pytest.importorskip("cyclonedds", reason="needs the extra 'ros2'")
    from node.bus.dds import LATCHED, RosParticipant
    from node.bus.messages import to_ros, typestore

    message = to_ros(a_level(), typestore())
    participant = RosParticipant(91, network=False)
    writer = participant.writer(LEVEL, message.type_name, LATCHED)
    writer.write(message.cdr)
    with closing(open_carrier("ros2:91")) as carrier:
        heard = wait_for(lambda: carrier.heard(0.2), LEVEL)
    assert heard.type_name == "murk_msgs/msg/NoiseLevel"
    assert heard.text == "62.5 % ± 4.0, snr; injected snr 60"


def test_a_recording_is_told_whole(tmp_path: Path) -> None:
    from node.bus.mcap import McapRecorder

    path = tmp_path / "drive.mcap"
    kept = a_plan(record={"path": path})
    with Bus() as bus:
        pipeline = Pipeline(kept, bus)
        recorder = McapRecorder(kept, bus)
        published = len(list(pipeline.run()))
        recorder.close()
    result = CliRunner().invoke(app, ["watch", str(path), "--json"])
    records = [json.loads(line) for line in result.stdout.splitlines()]
    assert records[-1]["type"] == "summary"
    assert records[-1]["topics"][LEVEL]["count"] == published
    levels = [record for record in records if record.get("topic") == LEVEL]
    assert all("injected snr 70" in record["text"] for record in levels)
    table = CliRunner().invoke(app, ["watch", str(path)]).stdout
    assert LEVEL in table


def test_the_rate_is_that_of_the_newest_messages() -> None:
    view = TopicView("NoiseLevel")
    for k in range(100):
        view.add(Heard("a", "NoiseLevel", k * 100_000_000, str(k)))
    assert view.rate_hz == pytest.approx(10.0)
    assert (view.count, view.text) == (100, "99")


@pytest.mark.parametrize("source", ["nothing", "can:", "ros2:x", "ros2:233", "missing.mcap"])
def test_what_is_no_carrier_is_refused(source: str) -> None:
    if source == "ros2:233":
        pytest.importorskip("cyclonedds", reason="needs the extra 'ros2'")
    with pytest.raises(InputError, match=r"is no carrier|no such file|DDS domain|domain"):
        open_carrier(source)
