"""Another implementation of DDS, Fast DDS in C++, hears murk and asks it for injections."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

pytest.importorskip("cyclonedds", reason="needs the extra 'ros2'")

from models.degrade.parameters import to_json
from models.estimate.level import NoiseLevel
from node.bus.in_process import Bus
from tests.ros2.listening import GHOSTS, ListenerProcess, noise_level, wait_until
from tests.ros2.outputs import open_output
from tests.ros2.test_ros2 import TOPIC

SOURCE = Path(__file__).with_name("fastdds.cpp")
HEADERS = ("fastdds/dds/topic/TypeSupport.hpp", "fastcdr/Cdr.h")


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = shutil.which("g++")
    missing = [name for name in HEADERS if not Path("/usr/include", name).exists()]
    if compiler is None or missing:
        pytest.skip("needs g++, libfastrtps-dev and libfastcdr-dev")
    built = tmp_path_factory.mktemp("fastdds") / "fastdds"
    command = [compiler, "-std=c++17", str(SOURCE), "-o", str(built), "-lfastrtps", "-lfastcdr"]
    subprocess.run(command, check=True)
    return built


@pytest.fixture
def fast(program: Path, domain: int) -> Iterator[Callable[..., ListenerProcess]]:
    started = []

    def start(*arguments: str) -> ListenerProcess:
        started.append(ListenerProcess([str(program), str(domain), *arguments]))
        return started[-1]

    yield start
    for one in started:
        one.close()


def fields(level: NoiseLevel) -> dict[str, object]:
    """Return the fields of ``murk_msgs/NoiseLevel``, as its .msg file says they are."""
    seconds, nanoseconds = divmod(level.stamp_ns, 10**9)
    injected = level.injected or {}
    return {
        "header": {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": level.sensor},
        "sequence": level.sequence,
        "dropped": level.dropped,
        "latency_ns": level.latency_ns,
        "level": level.level,
        "std_dev": level.std,
        "probabilities": list(level.probabilities),
        "raw": level.raw,
        "effort": level.effort,
        "kind": level.kind,
        "kinds": list(level.kind_probabilities),
        "kind_probabilities": list(level.kind_probabilities.values()),
        "injected_kinds": list(injected),
        "injected_levels": list(injected.values()),
        "injected_drawn": ["", to_json(GHOSTS)] if injected else [],
    }


def test_fast_dds_receives_noise_levels(domain: int, fast: Callable[..., ListenerProcess]) -> None:
    with Bus() as bus, closing(open_output(bus, domain)) as output:
        bus.publish(TOPIC, noise_level(0))
        listener = fast("listen", TOPIC, "NoiseLevel")  # a late joiner
        assert listener.next() == fields(noise_level(0))
        for number in range(1, 101):
            bus.publish(TOPIC, noise_level(number))
            assert listener.next() == fields(noise_level(number))
        assert output.counts()["dropped"] == 0


def test_fast_dds_receives_diagnostics(domain: int, fast: Callable[..., ListenerProcess]) -> None:
    listener = fast("listen", "/diagnostics", "DiagnosticArray")
    with Bus() as bus, closing(open_output(bus, domain)):
        wait_for = {"level": 1, "name": "murk_tunnel: front", "hardware_id": "world SensorID 0"}

        def warned(array: dict[str, list[dict[str, object]]]) -> bool:
            bus.publish(TOPIC, noise_level(4, level=40.0))
            return array["status"][1]["level"] == 1

        status = listener.until(warned)["status"][1]
        assert {name: status[name] for name in wait_for} == wait_for
        assert status["message"] == "noise level 40 % ± 3 %, snr"
        assert {"key": "dropped", "value": "9"} in status["values"]


def test_requests_that_are_none_break_nothing(
    domain: int, fast: Callable[..., ListenerProcess]
) -> None:
    made = []
    with (
        Bus() as bus,
        closing(open_output(bus, domain, lambda *request: made.append(request))) as output,
    ):
        fast("inject", "/murk/front/inject")
        wait_until(lambda: ("front", "snr", 60.0) in made)
        assert output.counts()["failed"] == 0
        bus.publish(TOPIC, noise_level(1))
        assert fast("listen", TOPIC, "NoiseLevel").next()["sequence"] == 1
