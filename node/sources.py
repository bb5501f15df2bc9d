"""Where a sensor's messages come from: a recording, a device, a bus or the simulated world."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from dbc.errors import InputError
from drivers.camera import FrameSource, is_live_camera, open_camera_source
from drivers.can_frames import CanFrames
from drivers.frame import Frame
from drivers.scan import MotionInput, RadarScan, RadarState
from node.live_sources import CanBusSource, LiveCameraSource, Lost
from node.recording import RecordingSource, is_recording
from node.scene import WORLD, Sensor

if TYPE_CHECKING:
    from models.world.road import World

Message = Frame | RadarScan | RadarState | MotionInput


class Source(Protocol):
    """One sensor's messages in order.

    ``live`` sources are paced by the sensor itself; the others are paced by the pipeline and may
    be read again from the start.
    """

    live: bool

    def messages(self) -> Iterator[Message | Lost]:
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
    if Path(source).exists() or is_recording(source):
        return False
    return ":" in source or (Path(source).name == source and "." not in source)


class CanLogSource:
    """Scans of one radar in a CAN log."""

    live = False

    def __init__(self, sensor: Sensor) -> None:
        self._sensor = sensor
        next(self._batches(), None)  # a file that is no log is told before the run begins

    def _batches(self) -> Iterator[CanFrames]:
        from drivers.can_log import read_log

        return read_log(Path(self._sensor.source))

    def messages(self) -> Iterator[Message]:
        """Yield the radar's messages; see ``Source``."""
        return _assembled(self._sensor, self._batches())

    def close(self) -> None:
        """Nothing stays open between reads."""


class CameraSource:
    """Frames of a video or of images."""

    live = False

    def __init__(self, sensor: Sensor, frames: FrameSource) -> None:
        self._sensor = sensor
        self._frames: FrameSource | None = frames

    def messages(self) -> Iterator[Message]:
        """Yield frames; see ``Source``."""
        frames = self._frames or open_camera_source(self._sensor.source, self._sensor.name)
        self._frames = None
        with frames:
            yield from frames

    def close(self) -> None:
        """Release a file that was opened and not read."""
        if self._frames is not None:
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
    if is_recording(sensor.source):
        return RecordingSource(sensor)
    if sensor.type == "camera":
        return _open_camera(sensor)
    return _open_bus(sensor) if is_can_bus(sensor.source) else CanLogSource(sensor)


def _open_bus(sensor: Sensor) -> Source:
    if sensor.settings is not None:
        from node.radar_config import apply_settings

        apply_settings(sensor)
    source = CanBusSource(sensor)
    if sensor.motion is not None:
        vehicle = sensor.model_copy(
            update={"source": sensor.motion, "sensor_id": 0, "motion": None}
        )
        try:
            source.send_motion(
                CanBusSource(vehicle) if is_can_bus(sensor.motion) else CanLogSource(vehicle)
            )
        except InputError:
            source.close()
            raise
    return source


def _open_camera(sensor: Sensor) -> Source:
    if not is_live_camera(sensor.source):
        return CameraSource(sensor, open_camera_source(sensor.source, sensor.name))
    from drivers.v4l2 import V4L2Camera

    camera = V4L2Camera(
        sensor.source,
        sensor.name,
        size=sensor.size,
        rate_hz=sensor.rate_hz,
        pixel_format=sensor.pixel_format,
    )
    return LiveCameraSource(camera)
