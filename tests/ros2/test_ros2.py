"""ROS 2 over DDS: what other processes receive, and what nobody's misbehaviour breaks."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import closing
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs the extra 'ros2'")

from dbc.errors import SceneError
from drivers.frame import Frame
from models.degrade.parameters import to_json
from node.bus.dds import (
    LATCHED,
    RELIABLE,
    SENSOR_DATA,
    RosParticipant,
)
from node.bus.in_process import Bus
from node.bus.messages import (
    InjectionRequest,
    deserialize,
    from_ros,
    to_ros,
    typestore,
)
from node.events import (
    EVENT_TOPIC,
    MODEL_TOPIC,
    STATE_TOPIC,
    LifecycleState,
    ModelChoice,
    NodeState,
)
from node.health import SensorEvent
from tests.drivers.radar_strategies import random_scan
from tests.ros2.listening import GHOSTS, ListenerProcess, noise_level, wait_until
from tests.ros2.outputs import open_output
from tests.ros2.test_messages import assert_same

TOPIC = "/murk/front/noise_level"
LEVEL = "murk_msgs/msg/NoiseLevel"
Listen = Callable[..., ListenerProcess]


def test_another_process_receives_every_field(bus: Bus, domain: int, listen: Listen) -> None:
    listener = listen(TOPIC)
    with closing(open_output(bus, domain)) as output:
        bus.publish(TOPIC, noise_level(7))
        assert listener.next() == {
            "header": {
                "stamp": {"sec": 1_700_000_000, "nanosec": 123_456_796},
                "frame_id": "front",
            },
            "sequence": 7,
            "dropped": 9,
            "latency_ns": 777,
            "level": 12.5,
            "std_dev": 3.25,
            "probabilities": [number / 66 for number in range(1, 12)],
            "raw": 14.5,
            "effort": 0.25,
            "kind": "snr",
            "kinds": ["clean", "snr"],
            "kind_probabilities": [0.25, 0.75],
            "injected_kinds": ["snr", "ghosts"],
            "injected_levels": [40.0, 5.0],
            "injected_drawn": ["", to_json(GHOSTS)],
        }
        for number in range(8, 30):
            bus.publish(TOPIC, noise_level(number))
            assert listener.next()["sequence"] == number
        assert output.counts()["failed"] == 0


@pytest.mark.parametrize("how", [(), ("volatile",)])
def test_a_late_joiner_gets_the_last_level(
    bus: Bus, domain: int, listen: Listen, how: tuple[str, ...]
) -> None:
    with closing(open_output(bus, domain)) as output:
        for number in range(4):
            bus.publish(TOPIC, noise_level(number))
        assert output.counts()["sent"] == 0
        listener = listen(TOPIC, "NoiseLevel", *how)
        assert listener.next()["sequence"] == 3


def test_whoever_comes_when_all_had_left_gets_no_old_level(
    bus: Bus, domain: int, listen: Listen
) -> None:
    with closing(open_output(bus, domain)) as output:
        first = listen(TOPIC)
        bus.publish(TOPIC, noise_level(1))
        assert first.next()["sequence"] == 1
        first.leave()
        wait_until(lambda: not output.readers(TOPIC))
        sent = output.counts()["sent"]
        bus.publish(TOPIC, noise_level(2))
        assert listen(TOPIC).next()["sequence"] == 2
        assert output.counts()["sent"] == sent + 1


def test_nothing_is_serialised_for_nobody(
    bus: Bus, domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with closing(open_output(bus, domain, scans=True, images=True)) as output:
        for number in range(20):
            bus.publish(TOPIC, noise_level(number))
            bus.publish("/murk/front/scan", random_scan(np.random.default_rng(0), 9, "cluster", []))
            bus.publish(STATE_TOPIC, NodeState("tunnel", 1, "active", number))
    assert output.counts()["sent"] == 0


def test_a_stopped_reader_stalls_nobody(bus: Bus, domain: int, listen: Listen) -> None:
    stopped, awake = listen(TOPIC), listen(TOPIC)
    with closing(open_output(bus, domain)):
        bus.publish(TOPIC, noise_level(0))
        assert stopped.next()["sequence"] == awake.next()["sequence"] == 0
        os.kill(stopped.process.pid, signal.SIGSTOP)
        try:
            for number in range(1, 500):
                bus.publish(TOPIC, noise_level(number))
                assert awake.next()["sequence"] == number
        finally:
            os.kill(stopped.process.pid, signal.SIGCONT)
        stopped.until(lambda message: message["sequence"] == 499)


def test_scans_and_images_are_rebuilt_from_what_is_sent(bus: Bus, domain: int) -> None:
    scan = random_scan(
        np.random.default_rng(3), 40, "cluster", [True], sensor="front", injected={"snr": 5.0}
    )
    image = np.full((90, 160, 3), 99, np.uint8)
    frame = Frame(image, "camera", 4, 1_000, "simulated")
    other = RosParticipant(domain, network=False)
    with closing(open_output(bus, domain, scans=True, images=True)):
        names = {
            "/murk/front/scan": "sensor_msgs/msg/PointCloud2",
            "/murk/front/scan_info": "murk_msgs/msg/RadarScanInfo",
            "/murk/camera/image/compressed": "sensor_msgs/msg/CompressedImage",
            "/murk/camera/image_info": "murk_msgs/msg/FrameInfo",
        }
        readers = {name: other.reader(name, kind, SENSOR_DATA) for name, kind in names.items()}
        got: dict[str, bytes] = {}

        def all_came() -> bool:
            bus.publish("/murk/front/scan", scan)
            bus.publish("/murk/camera/image", frame)
            got.update({name: cdr for name, reader in readers.items() for cdr in reader.take()})
            return len(got) == len(names)

        wait_until(all_came)
    cloud, cloud_info, picture, picture_info = (got[name] for name in names)
    store = typestore()
    assert_same(scan, from_ros("sensor_msgs/msg/PointCloud2", cloud, store, cloud_info))
    rebuilt = from_ros("sensor_msgs/msg/CompressedImage", picture, store, picture_info)
    assert np.abs(rebuilt.image.astype(int) - image).max() <= 3
    assert (rebuilt.sequence, rebuilt.stamp_ns) == (4, 1_000)


def test_only_what_the_scene_asks_for_is_announced(bus: Bus, domain: int) -> None:
    other = RosParticipant(domain, network=False)
    scans = other.reader("/murk/front/scan", "sensor_msgs/msg/PointCloud2", SENSOR_DATA)
    levels = other.reader(TOPIC, LEVEL, LATCHED)
    with closing(open_output(bus, domain)):
        bus.publish("/murk/front/scan", random_scan(np.random.default_rng(0), 9, "cluster", []))
        bus.publish(TOPIC, noise_level(1))
        wait_until(levels.take)
        assert not scans.take()


def test_choices_events_and_states_arrive(bus: Bus, domain: int) -> None:
    messages: dict[str, Any] = {
        "/murk/front/event": SensorEvent("front", 5, "stale", "silent for 0.3 s"),
        MODEL_TOPIC: ModelChoice("detector", 6, "radar_only", "camera_first", "fog"),
        STATE_TOPIC: NodeState("tunnel", 7, "active", 3),
    }
    other = RosParticipant(domain, network=False)
    with closing(open_output(bus, domain)):
        for topic, message in messages.items():
            bus.publish(topic, message)
            name = to_ros(message, typestore()).type_name
            reader = other.reader(topic, name, LATCHED)
            assert from_ros(name, wait_until(reader.take)[0], typestore()) == message


def test_transitions_are_those_of_a_managed_node(bus: Bus, domain: int) -> None:
    states: list[LifecycleState] = ["inactive", "active", "active", "inactive", "finalized"]
    other = RosParticipant(domain, network=False)
    type_name = "lifecycle_msgs/msg/TransitionEvent"
    reader = other.reader("/murk_tunnel/transition_event", type_name, RELIABLE)
    with closing(open_output(bus, domain)) as output:
        wait_until(lambda: output.readers("/murk_tunnel/transition_event"))
        for number, state in enumerate(states):
            bus.publish(STATE_TOPIC, NodeState("tunnel", number, state, number))
        events: list[Any] = []

        def all_came() -> bool:
            events.extend(deserialize(type_name, cdr, typestore()) for cdr in reader.take())
            return len(events) == 3

        wait_until(all_came)
    assert [event.transition.label for event in events] == ["activate", "deactivate", "shutdown"]
    assert [event.goal_state.id for event in events] == [3, 2, 4]


class Injections:
    """Stands for the pipeline: the sensor 'front' alone can be injected into."""

    def __init__(self) -> None:
        self.made: list[tuple[str, str, float | None]] = []

    def set(self, sensor: str, kind: str, level: float | None) -> None:
        if sensor != "front":
            raise SceneError(sensor, "has no injector")
        if kind != "snr" or not (level is None or 0 <= level <= 100):
            raise SceneError(f"{sensor}:{kind}", f"level {level}", "expected 0 to 100")
        self.made.append((sensor, kind, level))


def test_requests_are_carried_out_or_refused_with_a_reason(bus: Bus, domain: int) -> None:
    injections = Injections()
    other = RosParticipant(domain, network=False)
    said = bus.subscribe(EVENT_TOPIC)
    name = "murk_msgs/msg/Injection"
    with closing(open_output(bus, domain, injections.set)) as output:
        to = {
            sensor: other.writer(f"/murk/{sensor}/inject", name, RELIABLE)
            for sensor in ("front", "camera")
        }
        wait_until(lambda: all(writer.matched() for writer in to.values()))

        def ask(sensor: str, kind: str, level: float | None) -> None:
            to[sensor].write(to_ros(InjectionRequest(kind, level), typestore()).cdr)

        ask("front", "snr", 60.0)
        ask("front", "snr", None)
        wait_until(lambda: output.counts()["injections"] == 2)
        assert injections.made == [("front", "snr", 60.0), ("front", "snr", None)]
        for level in (float("nan"), float("inf"), -1.0, 100.5):
            ask("front", "snr", level)
        ask("front", "no such kind", 5.0)
        ask("camera", "blur", 5.0)
        wait_until(lambda: output.counts()["injections_refused"] == 6)
        event = next(iter(said))
        assert event.source == "ros2"
        assert "refused" in event.detail
        ask("front", "snr", 10.0)
        wait_until(lambda: output.counts()["injections"] == 3)
        assert output.counts()["failed"] == 0


def test_a_flood_of_bad_requests_is_said_once_a_while(bus: Bus, domain: int) -> None:
    injections = Injections()
    other = RosParticipant(domain, network=False)
    said: list[Any] = []
    bus.subscribe(EVENT_TOPIC, said.append, depth=1000)
    with closing(open_output(bus, domain, injections.set)) as output:
        writer = other.writer("/murk/front/inject", "murk_msgs/msg/Injection", RELIABLE)
        wait_until(writer.matched)
        cdr = to_ros(InjectionRequest("blur", 1.0), typestore()).cdr
        for _ in range(2000):
            writer.write(cdr)
        wait_until(lambda: output.counts()["injections_refused"] >= 10)
        assert len(said) <= 3


def test_two_nodes_of_one_name_both_say_so_and_go_on(bus: Bus, domain: int, listen: Listen) -> None:
    with Bus() as second_bus, closing(open_output(bus, domain)) as first:
        said, other_said = bus.subscribe(EVENT_TOPIC), second_bus.subscribe(EVENT_TOPIC)
        diagnostics = listen("/diagnostics", "DiagnosticArray", "volatile")
        with closing(open_output(second_bus, domain)) as second:
            for events in (said, other_said):
                assert "another node publishes" in next(iter(events)).detail
            assert first.counts()["rivals"] == second.counts()["rivals"] == 1
            warned = diagnostics.until(lambda array: array["status"][0]["level"] == 1)
            assert TOPIC in warned["status"][0]["message"]
            assert warned["status"][0]["name"] == "murk_tunnel: node"
            levels = listen(TOPIC)
            bus.publish(TOPIC, noise_level(1))
            second_bus.publish(TOPIC, noise_level(2))
            assert {levels.next()["sequence"], levels.next()["sequence"]} == {1, 2}
        diagnostics.until(lambda array: array["status"][0]["level"] == 0)


def test_nodes_with_other_sensors_and_names_are_no_rivals(bus: Bus, domain: int) -> None:
    with (
        closing(open_output(bus, domain)) as first,
        closing(open_output(bus, domain, name="other", namespace="b")),
    ):
        other = RosParticipant(domain, network=False)
        reader = other.reader("/b" + TOPIC, LEVEL, LATCHED)
        bus.publish(TOPIC, noise_level(1))
        wait_until(reader.take)
        wait_until(lambda: first.readers("/diagnostics") or True)
        assert first.counts()["rivals"] == 0


def test_diagnostics_have_a_status_a_sensor(bus: Bus, domain: int, listen: Listen) -> None:
    listener = listen("/diagnostics", "DiagnosticArray", "volatile")
    with closing(open_output(bus, domain)):
        first = listener.next()
        assert [
            (status["name"], status["level"], status["hardware_id"]) for status in first["status"]
        ] == [
            ("murk_tunnel: node", 0, ""),
            ("murk_tunnel: front", 3, "world SensorID 0"),
            ("murk_tunnel: camera", 3, "world"),
        ]

        def is_error(array: Any) -> bool:
            bus.publish(TOPIC, noise_level(1, level=88.0))
            return bool(array["status"][1]["level"] == 2)

        assert listener.until(is_error)["status"][1]["message"] == "noise level 88 % ± 3 %, snr"
        bus.publish("/murk/front/event", SensorEvent("front", 1, "lost", "can0 is down"))
        listener.until(lambda array: array["status"][1]["message"] == "can0 is down")
