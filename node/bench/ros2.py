"""From a message's arrival at the node until its level is in another process, over DDS.

A simulated radar and camera in real time, heard by a process that waits for their levels with the
same Cyclone DDS. A run time is the latency, an error the levels that were lost. The second latency
is the carrier's share: from when the level was published in process.

What a message costs is CPU time of the thread that serialises and writes it, for one reader in
another process and for none. Without the extra `ros2` nothing is measured.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib.util import find_spec
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from drivers.frame import Frame
from models.estimate.level import NoiseLevel
from models.evaluate.report import Goal, Point
from models.world.camera import WorldCamera
from models.world.radar import WorldRadar
from models.world.road import World
from node.bench.latency import LATE_S, QUICK_S, RUN_S, SENSORS, recorded_plan
from node.bus.in_process import Bus
from node.pipeline import Pipeline

LEVEL = "murk_msgs/msg/NoiseLevel"
MOST_LATENT_MS = 2.0
DOMAIN = 229
"""One that hardly anybody uses."""


def run(quick: bool) -> Iterator[Point | Goal]:
    """Measure latency to another process, and the cost of a message."""
    if find_spec("cyclonedds") is None:
        return
    latencies, lost = _latencies(QUICK_S if quick else RUN_S)
    for name, values_us in latencies.items():
        for percentile in (50, 99):
            value_us = float(np.percentile(values_us, percentile))
            yield Point(f"latency, {name}", f"p{percentile}", value_us, lost, "levels lost")
    carried_ms = float(np.median(latencies["published to another process (DDS)"])) / 1e3
    name = "from published to another process (DDS), p50, ms"
    yield Goal(name, carried_ms, MOST_LATENT_MS, at_least=False)
    yield Goal("levels lost between processes (DDS)", lost, 0, at_least=False)
    yield from _costs(quick)


class Published:
    """When each level was published and its message had arrived, monotonic, ns."""

    def __init__(self) -> None:
        self.times_ns: dict[tuple[str, int], tuple[int, int]] = {}

    def deliver(self, level: NoiseLevel) -> None:
        """Take in a level on the pipeline's own thread."""
        now_ns = time.monotonic_ns()
        self.times_ns[level.sensor, level.sequence] = (now_ns, now_ns - level.latency_ns)

    def close(self) -> None:
        """Nothing is open."""


def _latencies(duration_s: float) -> tuple[dict[str, list[float]], int]:
    """Return latencies by name, µs, and how many levels were lost.

    Both processes read the same monotonic clock.
    """
    from node.bus.ros2 import Ros2Output

    published = Published()
    with TemporaryDirectory() as folder, Bus() as bus, _listener(_hear_levels) as listener:
        outputs = {"ros2": {"domain": DOMAIN}}
        kept = recorded_plan(Path(folder), outputs, duration_s)
        for sensor in SENSORS:
            bus.attach(f"/murk/{sensor}/noise_level", published)
        pipeline = Pipeline(kept, bus)
        output = Ros2Output(kept, bus, pipeline.set_injection)
        while not all(output.readers(f"/murk/{sensor}/noise_level") for sensor in SENSORS):
            time.sleep(0.01)
        for _ in pipeline.run():
            pass
        time.sleep(LATE_S)
        output.close()
        listener.send(None)
        heard: dict[tuple[str, int], int] = listener.recv()
    times_ns = published.times_ns
    common = heard.keys() & times_ns.keys()
    return {
        "published to another process (DDS)": [
            (heard[one] - times_ns[one][0]) / 1e3 for one in common
        ],
        "arrived to another process (DDS)": [
            (heard[one] - times_ns[one][1]) / 1e3 for one in common
        ],
    }, len(times_ns.keys() - common)


def _costs(quick: bool) -> Iterator[Point]:
    """Yield what the carrier's thread spends on a message, for a reader and for none."""
    from node.bus.dds import LATCHED, SENSOR_DATA, RosParticipant
    from node.bus.messages import to_ros, type_name_of, typestore
    from node.bus.ros2_publication import Publication

    world = World(seed=1, duration_s=1.0)
    messages: dict[str, Any] = {
        "a noise level": _a_level(),
        "a scan": next(iter(WorldRadar(world).scans())),
        "a 1600×900 image": next(iter(WorldCamera(world, width=1600, height=900).frames())),
    }
    make = partial(to_ros, store=typestore())
    participant = RosParticipant(DOMAIN, network=False)
    for name, message in messages.items():
        type_name = type_name_of(type(message))
        qos = LATCHED if isinstance(message, NoiseLevel) else SENSOR_DATA
        publication = Publication(participant, "/bench", type_name, qos, make)
        repeat = 5 if isinstance(message, Frame) else 200
        repeat *= 1 if quick else 10
        send = partial(publication.send, message)
        for readers in (0, 1):
            with ExitStack() as listening:
                if readers:
                    listening.enter_context(_listener(partial(_take_all, type_name=type_name)))
                while publication.readers() != readers:
                    time.sleep(0.01)
                cpu_us = _cpu_us(send, repeat)
            knob = f"readers={readers}"
            yield Point(f"{name} over DDS", knob, cpu_us, publication.dropped, "messages dropped")
        publication.close()
    participant.close()


def _cpu_us(call: Callable[[], object], repeat: int) -> float:
    """Return CPU time of this process a call, µs: the median of five rounds."""
    rounds = []
    for _ in range(5):
        start_s = time.process_time()
        for _ in range(repeat):
            call()
        rounds.append((time.process_time() - start_s) / repeat)
    return median(rounds) * 1e6


@contextmanager
def _listener(listen: Callable[[Connection], None]) -> Iterator[Connection]:
    """Run ``listen`` in another process until what is given is told something, or left."""
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=listen, args=(theirs,), daemon=True)
    process.start()
    theirs.close()
    try:
        yield ours
    finally:
        ours.close()
        process.join()


def _hear_levels(connection: Connection) -> None:
    """Note when each level came, monotonic, ns; send that when told to."""
    from node.bus.dds import LATCHED, RosParticipant, RosWaiter
    from node.bus.messages import deserialize, typestore

    participant = RosParticipant(DOMAIN, network=False)
    topics = [f"/murk/{sensor}/noise_level" for sensor in SENSORS]
    readers = [participant.reader(topic, LEVEL, LATCHED) for topic in topics]
    waiter = RosWaiter(participant, readers)
    heard_ns: dict[tuple[str, int], int] = {}
    while not connection.poll():
        waiter.wait(LATE_S)
        now_ns = time.monotonic_ns()
        for reader in readers:
            for cdr in reader.take():
                level = deserialize(LEVEL, cdr, typestore())
                heard_ns.setdefault((level.header.frame_id, level.sequence), now_ns)
    connection.send(heard_ns)


def _take_all(connection: Connection, type_name: str) -> None:
    """Take whatever comes until the other side hangs up."""
    from node.bus.dds import LATCHED, SENSOR_DATA, RosParticipant, RosWaiter

    participant = RosParticipant(DOMAIN, network=False)
    qos = LATCHED if type_name == LEVEL else SENSOR_DATA
    reader = participant.reader("/bench", type_name, qos)
    waiter = RosWaiter(participant, [reader])
    while not connection.poll():
        waiter.wait(LATE_S)
        reader.take()


def _a_level() -> NoiseLevel:
    return NoiseLevel(
        sensor="radar",
        stamp_ns=time.time_ns(),
        level=40.0,
        std=5.0,
        probabilities=np.full(11, 1 / 11),
        kind="snr",
        kind_probabilities={"clean": 0.1, "snr": 0.6, "ghosts": 0.1, "missed": 0.1, "jitter": 0.1},
        raw=42.0,
        injected={"snr": 40.0},
        latency_ns=5_000_000,
        sequence=1,
        dropped=0,
    )
