"""A node on CAN buses: several radars, what the controller says, and an interface that goes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from threading import Thread
from typing import Any

import numpy as np
import pytest

from dbc.errors import DeviceError
from drivers import can_bus
from drivers.can_bus import BusDown, CanBus, open_bus
from drivers.can_frames import NO_FRAMES, CanFrames, FrameFlag
from drivers.scan import RadarScan
from node.bus.in_process import Bus
from node.live_sources import LONGEST_GATHER_S, CanBusSource, Lost, gather_s
from node.pipeline import Pipeline
from node.plan import plan
from node.scene import Sensor, check_scene
from tests.node.gateway_stream import merged, other_frames, radar_frames

RADAR = Sensor(name="radar", type="radar", source="scripted")
PATIENCE_S = 20.0


def test_radars_on_one_bus_and_on_several_are_told_apart() -> None:
    sensors = [
        {"name": name, "type": "radar", "source": f"virtual:{bus}", "sensor_id": sensor_id}
        for name, bus, sensor_id in (("front", "one", 0), ("left", "one", 1), ("rear", "two", 0))
    ]
    with Bus() as bus, open_bus("virtual:one") as one, open_bus("virtual:two") as two:
        pipeline = Pipeline(plan(check_scene({"sensors": sensors}, "test")), bus)
        said = {name: bus.subscribe(f"/murk/{name}/scan") for name in ("front", "left", "rear")}
        run = Thread(target=lambda: list(pipeline.run()))
        run.start()
        one.send(merged(radar_frames(0, 40), radar_frames(0, 30, sensor_id=1)))
        two.send(radar_frames(0, 20))
        first = {name: next(iter(scans)) for name, scans in said.items()}
        pipeline.stop()
        run.join(PATIENCE_S)
    assert {name: len(scan) for name, scan in first.items()} == {
        "front": 40,
        "left": 30,
        "rear": 20,
    }


class Script(CanBus):
    """A bus on which happens what a list says, one entry a read; then nothing."""

    def __init__(self, *happens: CanFrames | BusDown, dropped: int = 0) -> None:
        super().__init__("scripted", listen_only=True)
        self._happens = iter(happens)
        self.dropped = dropped
        self.closed = False

    def read(self, timeout_s: float) -> CanFrames:
        what = next(self._happens, NO_FRAMES)
        if isinstance(what, BusDown):
            raise what
        return replace(what, dropped=self.dropped)

    def _send(self, frames: CanFrames) -> None:
        raise AssertionError("nothing is sent")

    def close(self) -> None:
        self.closed = True


def play(monkeypatch: pytest.MonkeyPatch, *buses: Script | DeviceError) -> Iterator[Any]:
    """Yield what a source says that opens these buses one after the other."""
    to_open = iter(buses)

    def open_next(*_: object, listen_only: bool) -> CanBus:
        assert listen_only, "a node that only reads says so"
        bus = next(to_open)
        if isinstance(bus, DeviceError):
            raise bus
        return bus

    monkeypatch.setattr(can_bus, "open_bus", open_next)
    source = CanBusSource(RADAR)
    yield from source.messages()


def error_frame(error_class: int, controller: int = 0) -> CanFrames:
    frame = other_frames([0], [error_class])
    frame.flags[:] = FrameFlag.ERROR
    data = np.array([[0, controller, 0, 0, 0, 0, 0, 0]], np.uint8)
    return replace(frame, data=data)


@pytest.mark.parametrize(
    ("frame", "state"),
    [
        (error_frame(0x004, 0x10), "error passive"),
        (error_frame(0x004, 0x08), "error warning"),
        (error_frame(0x040), "bus-off"),
    ],
)
def test_what_the_controller_says_is_told_and_scans_go_on(
    monkeypatch: pytest.MonkeyPatch, frame: CanFrames, state: str
) -> None:
    said = play(monkeypatch, Script(radar_frames(0), frame, error_frame(0x100), radar_frames(1)))
    before, told, after = next(said), next(said), next(said)
    assert isinstance(before, RadarScan)
    assert isinstance(told, Lost)
    assert told.detail == f"scripted: the controller is {state}"
    assert isinstance(after, RadarScan)


def test_an_interface_that_goes_is_opened_again_and_its_drops_are_added_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gone = BusDown("scripted", "the interface has gone", gone=True)
    first = Script(radar_frames(0), gone, dropped=5)
    not_yet = DeviceError("scripted", "there is no such CAN interface")
    said = play(monkeypatch, first, not_yet, not_yet, Script(radar_frames(1), dropped=2))
    before, told, after = next(said), next(said), next(said)
    assert isinstance(told, Lost)
    assert told.detail == "scripted: the interface has gone"
    assert first.closed
    assert (before.dropped, after.dropped) == (5, 7)


def test_a_network_that_is_down_is_told_and_read_on(monkeypatch: pytest.MonkeyPatch) -> None:
    down = BusDown("scripted", "the network is down")
    bus = Script(radar_frames(0), down, down, radar_frames(1))
    kinds = [type(message) for _, message in zip(range(4), play(monkeypatch, bus), strict=False)]
    assert kinds == [RadarScan, Lost, Lost, RadarScan]


@pytest.mark.parametrize("spacing_ns", [0, 20_000, 250_000, 10_000_000])
def test_frames_gather_no_longer_than_the_scan_takes(spacing_ns: int) -> None:
    frames = replace(radar_frames(0), stamp_ns=np.arange(81) * spacing_ns)
    pauses_s = np.array([gather_s(missing, frames) for missing in range(500)])
    assert (np.diff(pauses_s) >= 0).all()
    assert (pauses_s - pauses_s[0] <= np.arange(500) * spacing_ns * 1e-9 + 1e-9).all()
    assert pauses_s.max() <= LONGEST_GATHER_S


def test_a_status_frame_alone_tells_no_pace() -> None:
    assert gather_s(250, radar_frames(0).select(slice(0, 1))) == gather_s(0, radar_frames(0))
