"""A node's life: its states, its heartbeat, and what can be changed while it runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread

import pytest

from dbc.errors import SceneError
from models.estimate.level import NoiseLevel
from node.bus.in_process import Bus
from node.control import ControlError, set_level
from node.events import EVENT_TOPIC, STATE_TOPIC, NodeState
from node.lifecycle import Lifecycle
from node.parameters import Parameters
from node.pipeline import Pipeline
from node.plan import plan
from node.scene import check_scene


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def bus() -> Iterator[Bus]:
    with Bus() as bus:
        yield bus


@pytest.fixture
def pipeline(bus: Bus) -> Iterator[Pipeline]:
    content = {
        "name": "drive",
        "sensors": [{"name": "radar", "type": "radar", "source": "world"}],
        "injections": [{"sensor": "radar", "kind": "snr", "level": 0}],
        "duration_s": 60.0,
    }
    pipeline = Pipeline(plan(check_scene(content, "test")), bus)
    yield pipeline
    pipeline.close()


def wait_until(is_so: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + 20
    while not is_so():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def states_of(bus: Bus, seen: list[NodeState]) -> None:
    bus.subscribe(STATE_TOPIC, seen.append, depth=100)


def test_a_run_goes_through_its_states_and_ends_finalized(bus: Bus) -> None:
    seen: list[NodeState] = []
    states_of(bus, seen)
    content = {
        "sensors": [{"name": "radar", "type": "radar", "source": "world"}],
        "duration_s": 0.5,
        "clock": {"fast": True},
    }
    list(Pipeline(plan(check_scene(content, "test")), bus).run())
    wait_until(lambda: seen and seen[-1].state == "finalized")
    states = list(dict.fromkeys(state.state for state in seen))
    assert states == ["unconfigured", "inactive", "active", "finalized"]
    assert [state.sequence for state in seen] == list(range(len(seen)))


def test_a_node_that_cannot_be_configured_is_finalized(bus: Bus) -> None:
    content = {"sensors": [{"name": "radar", "type": "radar", "source": "no_such_bus:x"}]}
    with pytest.raises(Exception, match="no_such_bus"):
        Pipeline(plan(check_scene(content, "test")), bus)
    assert bus.latest(STATE_TOPIC).state == "finalized"


def test_the_heart_beats_while_nothing_changes(bus: Bus) -> None:
    seen: list[NodeState] = []
    states_of(bus, seen)
    life = Lifecycle("drive", bus)
    wait_until(lambda: len(seen) >= 2)
    assert {state.state for state in seen} == {"unconfigured"}
    life.close()
    life.enter("active")
    assert life.state == "finalized"


def test_an_inactive_node_reads_on_and_says_nothing(bus: Bus, pipeline: Pipeline) -> None:
    levels: list[NoiseLevel] = []
    run = Thread(target=lambda: levels.extend(pipeline.run()))
    with Parameters(pipeline, bus):
        run.start()
        wait_until(lambda: bus.latest("/murk/radar/noise_level"))
        set_level("drive", "active", 0, role="node")
        assert bus.latest(STATE_TOPIC).state == "inactive"
        wait_until(lambda: pipeline.summary()["sensors"]["radar"].get("left_aside", 0) > 2)
        said = bus.latest("/murk/radar/noise_level").sequence
        set_level("drive", "active", 1, role="node")
        wait_until(lambda: bus.latest("/murk/radar/noise_level").sequence > said)
        assert bus.latest(STATE_TOPIC).state == "active"
        pipeline.stop()
        run.join()
    assert pipeline.summary()["sensors"]["radar"]["dropped_by_queue"] == 0


def test_an_injection_is_changed_from_outside(bus: Bus, pipeline: Pipeline) -> None:
    run = Thread(target=lambda: list(pipeline.run()))
    with Parameters(pipeline, bus):
        run.start()
        set_level("drive", "radar.snr", 60, role="node")
        latest = "/murk/radar/noise_level"
        wait_until(lambda: bus.latest(latest) and bus.latest(latest).injected == {"snr": 60})
        assert bus.latest(EVENT_TOPIC).detail == "radar.snr = 60"
        pipeline.stop()
        run.join()


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("speed", 1, "is no parameter"),
        ("active", 2, "cannot be 2"),
        ("camera.blur", 10, "is no sensor"),
        ("radar.blur", 10, "has no kind"),
        ("radar.snr", 101, "expected 0 to 100"),
    ],
)
def test_what_cannot_be_set_is_refused_and_nothing_happens(
    bus: Bus, pipeline: Pipeline, name: str, value: float, message: str
) -> None:
    with Parameters(pipeline, bus), pytest.raises(SceneError, match=message):
        set_level("drive", name, value, role="node")
    assert bus.latest(EVENT_TOPIC) is None


def test_a_second_node_of_the_same_name_runs_and_says_so(bus: Bus, pipeline: Pipeline) -> None:
    with Parameters(pipeline, bus):
        assert bus.latest(EVENT_TOPIC) is None
        with Parameters(pipeline, bus):
            assert "drive: has a running node already" in bus.latest(EVENT_TOPIC).detail


def test_a_node_that_does_not_run_cannot_be_told_anything() -> None:
    with pytest.raises(ControlError, match="drive: has no running node; none is running"):
        set_level("drive", "active", 1, role="node")
