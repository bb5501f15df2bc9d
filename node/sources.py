"""Where a sensor's messages come from: a recording, a device, a bus or the simulated world."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Protocol

from drivers.camera import FrameSource
from drivers.can_frames import CanFrames
from drivers.frame import Frame
from drivers.scan import MotionInput, RadarScan, RadarState
from node.scene import WORLD, Sensor

if TYPE_CHECKING:
    from drivers.can_bus import CanBus
    from models.world.road import World

Message = Frame | RadarScan | RadarState | MotionInput

BUS_TIMEOUT_S = 0.2
"""How long a read from a silent bus blocks before it looks whether the run should stop."""


class Source(Protocol):
    """One sensor's messages in order.

    ``live`` sources are paced by the sensor itself; the others are paced by the pipeline and may
    be read again from the start.
    """

    live: bool

    def messages(self) -> Iterator[Message]:
        """Yield messages until the recording ends or ``close`` is called.

        Raises
        ------
        InputError
            If the recording or the device turns out bad; what came before has been yielded.
        """

    def close(self) -> None:
        """Make ``messages`` end soon and release what is open."""


def is_can_bus(source: str) -> bool:
    """Tell a CAN bus (``INTERFACE:CHANNEL``, ``can0``, ``vcan0``) from a file's path."""
    if Path(source).exists():
        return False
    return ":" in source or (Path(source).name == source and "." not in source)


class CanLogSource:
    """Scans of one radar in a CAN log."""

    live = False

    def __init__(self, sensor: Sensor) -> None:
        self._sensor = sensor

    def messages(self) -> Iterator[Message]:
        """Yield the radar's messages; see ``Source``."""
        from drivers.can_log import read_log

        return _assembled(self._sensor, read_log(Path(self._sensor.source)))

    def close(self) -> None:
        """Nothing stays open between reads."""


class CanBusSource:
    """Scans of one radar on a CAN bus."""

    live = True

    def __init__(self, sensor: Sensor) -> None:
        from drivers.ars408 import sensor_can_ids
        from drivers.can_bus import open_bus

        self._sensor = sensor
        self._stop = Event()
        self._bus: CanBus = open_bus(sensor.source, ids=sensor_can_ids(sensor.sensor_id))

    def _batches(self) -> Iterator[CanFrames]:
        while not self._stop.is_set():
            frames = self._bus.read(BUS_TIMEOUT_S)
            if len(frames):
                yield frames

    def messages(self) -> Iterator[Message]:
        """Yield the radar's messages; see ``Source``."""
        try:
            yield from _assembled(self._sensor, self._batches())
        finally:
            self._bus.close()

    def close(self) -> None:
        """Stop at the next time-out of the bus."""
        self._stop.set()


class CameraSource:
    """Frames of a video, of images or of a live camera."""

    def __init__(self, sensor: Sensor) -> None:
        self._sensor = sensor
        self._frames = self._open()
        self.live = self._frames.live
        self._read = False

    def _open(self) -> FrameSource:
        from drivers.camera import open_camera_source

        return open_camera_source(self._sensor.source, self._sensor.name)

    def messages(self) -> Iterator[Message]:
        """Yield frames; see ``Source``."""
        if self._read:
            self._frames = self._open()
        self._read = True
        return self._frames

    def close(self) -> None:
        """Release the file or the device."""
        self._frames.close()


class WorldRadarSource:
    """The simulated radar, over its CAN frames as a real one."""

    live = False

    def __init__(self, sensor: Sensor, world: World) -> None:
        from models.world.radar import WorldRadar

        self._sensor = sensor
        self._radar = WorldRadar(world, sensor=sensor.name, sensor_id=sensor.sensor_id)

    def messages(self) -> Iterator[Message]:
        """Yield the radar's messages; see ``Source``."""
        return _assembled(self._sensor, self._radar.frames())

    def close(self) -> None:
        """Nothing is open."""


class WorldCameraSource:
    """The simulated camera."""

    live = False

    def __init__(self, sensor: Sensor, world: World) -> None:
        from models.world.camera import WorldCamera

        self._camera = WorldCamera(world, sensor=sensor.name)

    def messages(self) -> Iterator[Message]:
        """Yield frames; see ``Source``."""
        return self._camera.frames()

    def close(self) -> None:
        """Nothing is open."""


def _assembled(sensor: Sensor, batches: Iterator[CanFrames]) -> Iterator[Message]:
    from drivers.ars408 import ScanAssembler

    assembler = ScanAssembler({sensor.sensor_id: sensor.name})
    for frames in batches:
        yield from assembler.feed(frames)
    yield from assembler.flush()


def open_source(sensor: Sensor, world: World | None) -> Source:
    """Open where a sensor's messages come from.

    Parameters
    ----------
    world:
        The simulated world, for sensors whose source it is.

    Raises
    ------
    InputError
        If the file, device or bus cannot be opened.
    """
    if sensor.source == WORLD:
        assert world is not None, "plan() keeps the world where a sensor needs it"
        radar = sensor.type == "radar"
        return WorldRadarSource(sensor, world) if radar else WorldCameraSource(sensor, world)
    if sensor.type == "camera":
        return CameraSource(sensor)
    return CanBusSource(sensor) if is_can_bus(sensor.source) else CanLogSource(sensor)
