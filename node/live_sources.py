"""Live sensors, which come and go: a CAN bus that goes down, a camera that is unplugged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from threading import Event
from typing import TYPE_CHECKING

from dbc.errors import DeviceError
from drivers.can_frames import CanFrames
from drivers.frame import Frame
from node.scene import Sensor

if TYPE_CHECKING:
    from drivers.can_bus import CanBus
    from drivers.v4l2 import V4L2Camera
    from node.motion import MotionSender
    from node.sources import Message, Source

BUS_TIMEOUT_S = 0.2
"""How long a read from a silent bus blocks before it looks whether the run should stop."""
SHORTEST_GATHER_S, LONGEST_GATHER_S = 0.002, 0.06
"""Pause after a read: frames gather, and cost less together than one by one."""
SHORTEST_FRAME_S = 222e-6
"""A frame with 8 bytes at 500 kbit/s, 111 bits: no radar sends faster, but a recording may."""
FIRST_RETRY_S = 0.1
LONGEST_RETRY_S = 2.0
FROZEN_FRAMES = 10
"""Equal images in a row after which a picture counts as frozen; a real sensor's noise differs."""


class Lost:
    """Yielded in place of a message when the bus or device is down; reading goes on.

    Attributes
    ----------
    detail:
        One line for a person.
    frame:
        The frame that came all the same, where the picture is frozen.
    """

    def __init__(self, detail: str, frame: Frame | None = None) -> None:
        self.detail = detail
        self.frame = frame


def gather_s(missing: int, frames: CanFrames) -> float:
    """Return how long to let frames gather before the next read, s.

    Parameters
    ----------
    missing:
        How many frames have to come before there is a scan: nobody waits for them one by one.
    frames:
        What came last; it shows how fast they come.
    """
    if len(frames) < 2:
        return SHORTEST_GATHER_S
    span_s = float(frames.stamp_ns[-1] - frames.stamp_ns[0]) * 1e-9
    spacing_s = min(max(span_s / (len(frames) - 1), 0.0), SHORTEST_FRAME_S)
    return min(LONGEST_GATHER_S, SHORTEST_GATHER_S + missing * spacing_s)


class CanBusSource:
    """Scans of one radar on a CAN bus; it waits for a bus that is down, and says so.

    The bus is open for listening only, unless the scene has the radar told how the vehicle moves.
    """

    live = True

    def __init__(self, sensor: Sensor) -> None:
        self._sensor = sensor
        self._sensor_id = sensor.sensor_id
        self._stop = Event()
        self._bus: CanBus = self._open()
        self._dropped_before = 0
        self._motion: MotionSender | None = None

    def send_motion(self, source: Source) -> None:
        """Tell the radar the motion that another source has, from when ``messages`` is read."""
        from node.motion import MotionSender

        self._motion = MotionSender(source, lambda frames: self._bus.send(frames), self._sensor_id)

    def _open(self) -> CanBus:
        from drivers.ars408 import sensor_can_ids
        from drivers.can_bus import open_bus

        ids = sensor_can_ids(self._sensor_id)
        return open_bus(self._sensor.source, ids, listen_only=self._sensor.motion is None)

    def messages(self) -> Iterator[Message | Lost]:
        """Yield the radar's messages, and ``Lost`` when the bus fails; see ``Source``."""
        from drivers.ars408 import ScanAssembler

        assembler = ScanAssembler({self._sensor_id: self._sensor.name})
        if self._motion is not None:
            self._motion.start()
        try:
            for batch in self._batches():
                if isinstance(batch, Lost):
                    yield batch
                else:
                    yield from assembler.feed(batch)
                    self._stop.wait(gather_s(assembler.missing, batch))
        finally:
            if self._motion is not None:
                self._motion.close()
            self._bus.close()

    def _batches(self) -> Iterator[CanFrames | Lost]:
        from drivers.can_bus import BusDown
        from drivers.can_errors import bus_states

        while not self._stop.is_set():
            try:
                frames = self._bus.read(BUS_TIMEOUT_S)
            except BusDown as down:
                yield Lost(str(down))
                if down.gone:
                    self._reopen()
                continue
            for state in bus_states(frames):
                if state != "error active":
                    yield Lost(f"{self._sensor.source}: the controller is {state}")
            if len(frames):
                yield replace(frames, dropped=self._dropped_before + frames.dropped)

    def _reopen(self) -> None:
        self._dropped_before += self._bus.dropped
        self._bus.close()
        for _ in _back_off(self._stop):
            try:
                self._bus = self._open()
            except DeviceError:
                continue
            return

    def close(self) -> None:
        """Stop at the next time-out of the bus."""
        self._stop.set()


class LiveCameraSource:
    """Frames of a live camera; it waits for one that stalls or is unplugged, and says so."""

    live = True

    def __init__(self, camera: V4L2Camera) -> None:
        self._camera = camera
        self._stop = Event()

    def messages(self) -> Iterator[Message | Lost]:
        """Yield frames, and ``Lost`` when the camera fails or its picture is frozen."""
        from drivers.v4l2 import CameraLost, CameraStalled

        while not self._stop.is_set():
            try:
                frame = next(self._camera)
                frozen = self._camera.frozen >= FROZEN_FRAMES
                yield Lost(f"the same picture {FROZEN_FRAMES} times", frame) if frozen else frame
            except StopIteration:
                return
            except CameraStalled as stalled:
                yield Lost(str(stalled))
            except CameraLost as lost:
                yield Lost(str(lost))
                self._reopen()

    def _reopen(self) -> None:
        for _ in _back_off(self._stop):
            try:
                self._camera.reopen()
            except DeviceError:
                continue
            return

    def close(self) -> None:
        """Release the camera; safe from another thread."""
        self._stop.set()
        self._camera.close()


def _back_off(stop: Event) -> Iterator[float]:
    """Yield after ever longer waits, until ``stop`` is set."""
    wait_s = FIRST_RETRY_S
    while not stop.wait(wait_s):
        yield wait_s
        wait_s = min(2 * wait_s, LONGEST_RETRY_S)
