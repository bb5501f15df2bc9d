"""From a message's arrival at the node until its level is at a listener: in process, and over CAN.

A simulated radar and camera in real time. CAN is a SocketCAN interface where `vcan0` is up, and a
`virtual` bus of python-can elsewhere; the unit of each point says which. A run time is the latency,
an error the levels that were lost.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread
from typing import Any

import numpy as np

from drivers.candump import write_candump
from drivers.socketcan import can_interfaces
from drivers.video_writer import VideoWriter
from models.estimate.level import NoiseLevel
from models.evaluate.report import Point
from models.world.camera import WorldCamera
from models.world.radar import WorldRadar
from models.world.road import World
from node.bus.can import CanOutput
from node.bus.can_levels import FIRST_ID, LevelReader
from node.bus.in_process import Bus
from node.pipeline import Pipeline
from node.plan import Plan, plan
from node.scene import check_scene

SENSORS = ("radar", "camera")
RUN_S, QUICK_S = 20.0, 3.0
LATE_S = 0.5
"""How long after the run a listener still waits for what is on its way."""


class Arrivals:
    """When the message of each sensor's newest level reached the node, monotonic, ns."""

    def __init__(self) -> None:
        self.newest_ns: dict[str, int] = {}

    def deliver(self, message: NoiseLevel) -> None:
        """Take in a level on the pipeline's own thread."""
        self.newest_ns[message.sensor] = time.monotonic_ns() - message.latency_ns

    def close(self) -> None:
        """Nothing is open."""


def run(quick: bool) -> Iterator[Point]:
    """Measure latencies to a listener in process, and to one on a CAN bus."""
    interface = "vcan0" if "vcan0" in can_interfaces() else None
    with TemporaryDirectory() as folder:
        outputs = {"can": {"bus": interface or "virtual:latency"}}
        kept = recorded_plan(Path(folder), outputs, QUICK_S if quick else RUN_S)
        measured = _measure(kept, f"CAN ({interface or 'python-can virtual'})")
    for name, (latencies, lost) in measured.items():
        for percentile in (50, 99):
            value = float(np.percentile(latencies, percentile)) / 1e3
            yield Point(f"latency, {name}", f"p{percentile}", value, lost, "levels lost")


def recorded_plan(folder: Path, outputs: dict[str, Any], duration_s: float) -> Plan:
    """Return a plan that plays a radar and a camera, recorded into ``folder``, in real time."""
    world = World(seed=1, duration_s=4.0)
    log, clip = folder / "world.log", folder / "world.mp4"
    write_candump(log, WorldRadar(world).frames())
    with VideoWriter(clip) as writer:
        for frame in WorldCamera(world).frames():
            writer.write(frame.image, frame.stamp_ns)
    sources = zip(SENSORS, (log, clip), strict=True)
    content = {
        "sensors": [{"name": name, "type": name, "source": str(path)} for name, path in sources],
        "clock": {"loop": True},
        "duration_s": duration_s,
        "outputs": outputs,
    }
    return plan(check_scene(content, "bench"))


def _measure(kept: Plan, carrier: str) -> dict[str, tuple[list[int], int]]:
    """Return latencies, ns, and levels lost, in process and over CAN."""
    assert kept.scene.outputs.can is not None
    in_process: list[int] = []
    over_can: list[int] = []
    ended = Event()
    arrivals = Arrivals()
    with Bus() as bus, LevelReader(kept.scene.outputs.can.bus) as reader:
        for sensor in SENSORS:
            bus.attach(f"/murk/{sensor}/noise_level", arrivals)

        def take(level: NoiseLevel) -> None:
            in_process.append(time.monotonic_ns() - arrivals.newest_ns[level.sensor])

        topics = (f"/murk/{sensor}/noise_level" for sensor in SENSORS)
        subscriptions = [bus.subscribe(topic, take) for topic in topics]
        pipeline = Pipeline(kept, bus)
        output = CanOutput(kept, bus)
        listener = Thread(target=_listen, args=(reader, arrivals, over_can, ended))
        listener.start()
        for _ in pipeline.run():
            pass
        time.sleep(LATE_S)
        output.close()
        ended.set()
        listener.join()
        counts = output.counts()
        lost = counts["failed"] + counts["dropped"] + reader.lost + reader.corrupt
        dropped = sum(subscription.dropped for subscription in subscriptions)
    return {"in process": (in_process, dropped), carrier: (over_can, lost)}


def _listen(reader: LevelReader, arrivals: Arrivals, latencies: list[int], ended: Event) -> None:
    """Note when the first frame comes of each sensor's newest level; later ones repeat it."""
    heard_ns: dict[str, int] = {}
    while not ended.is_set():
        for heard in reader.read(0.1):
            sensor = SENSORS[heard.can_id - FIRST_ID]
            arrival_ns = arrivals.newest_ns.get(sensor)
            if arrival_ns is None or heard.state != "ok" or heard_ns.get(sensor) == arrival_ns:
                continue
            heard_ns[sensor] = arrival_ns
            latencies.append(time.monotonic_ns() - arrival_ns)
