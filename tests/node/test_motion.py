from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from threading import Event, Thread
from time import sleep

import numpy as np

from drivers.ars408 import ScanAssembler
from drivers.can_bus import open_bus
from drivers.can_frames import CanFrames
from drivers.candump import write_candump
from drivers.encode import encode_motion
from drivers.scan import MotionInput
from node.motion import MotionSender
from node.scene import Sensor
from node.sources import open_source


class Vehicle:
    """A live source that has told its motion once."""

    live = True

    def __init__(self) -> None:
        self.ended = Event()

    def messages(self) -> Iterator[MotionInput]:
        yield MotionInput(0, 0, speed=-3.0, yaw_rate=1.5)
        self.ended.wait(10)

    def close(self) -> None:
        self.ended.set()


def test_the_newest_motion_is_repeated_and_a_stale_one_is_not() -> None:
    sent: list[CanFrames] = []
    sender = MotionSender(Vehicle(), sent.append, sensor_id=2)
    sender.start()
    sleep(1.6)
    while_fresh = len(sent)
    sleep(0.4)
    sender.close()
    assert while_fresh > 2
    assert len(sent) == while_fresh
    assembler = ScanAssembler({2: "radar"})
    motions = [item for frames in sent for item in assembler.feed(frames)]
    last = motions[-1]
    assert isinstance(last, MotionInput)
    assert (last.sensor_id, last.speed, last.yaw_rate) == (2, -3.0, 1.5)


def test_a_log_of_the_vehicle_drives_a_radar_on_a_bus(tmp_path: Path) -> None:
    log = tmp_path / "vehicle.log"
    stamps = range(10**18, 10**18 + 400_000_000, 50_000_000)
    write_candump(log, (encode_motion(10.0, 0.0, stamp_ns=stamp) for stamp in stamps))
    sensor = Sensor(name="radar", type="radar", source="virtual:motion", motion=str(log))
    source = open_source(sensor, None)
    with open_bus("virtual:motion") as radar:
        messages = source.messages()
        source_ends = Event()

        def read() -> None:
            list(messages)
            source_ends.set()

        Thread(target=read, daemon=True).start()
        ids = np.concatenate([radar.read(0.2).can_id for _ in range(5)])
        source.close()
        assert source_ends.wait(5)
    assert {0x300, 0x301} == set(ids.tolist())
