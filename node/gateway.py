"""The gateway between a sensor and the unit under test: a worse sensor, and nothing else.

::

    with Gateway(scene, "vcan1") as gateway:
        gateway.set("snr", 60)
"""

from __future__ import annotations

from threading import Event, Thread
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from dbc.errors import InputError
from drivers.frame_sink import PIPE_PREFIX
from node.control import ControlServer
from node.gateway_levels import GatewayLevels
from node.gateway_log import is_candump
from node.gateway_scene import GatewayScene
from node.scene import SensorType
from node.sources import is_can_bus

if TYPE_CHECKING:
    from node.gateway_bus import CanLink
    from node.gateway_video import VideoLink

CLOSE_S = 10.0
"""A gateway that has not ended this long after it was stopped hangs."""


def sensor_type_of(target: str) -> SensorType:
    """Tell by its output what a gateway passes on: a camera's frames or a radar's."""
    if target == "-" or target.startswith(PIPE_PREFIX):
        return "camera"
    return "radar" if is_candump(target) or is_can_bus(target) else "camera"


class Gateway:
    """Passes one sensor's stream on, degraded; in a thread of its own from ``start`` on.

    Use it as a context manager, or call ``start`` and ``stop``.

    Parameters
    ----------
    scene:
        The sensor, whose source is the input, and what is done to it.
    target:
        A CAN bus; or for a camera, what ``drivers.frame_sink.open_frame_sink`` takes.
    both_ways:
        CAN only: also send what comes from the output to the input, untouched.
    low_latency:
        CAN only: send each cluster when it comes; see ``node.gateway_can.CanGateway``.
    control:
        Listen to ``murk gateway set``.

    Raises
    ------
    InputError
        If input or output cannot be opened, or a gateway for this sensor runs already.
    """

    def __init__(
        self,
        scene: GatewayScene,
        target: str,
        *,
        both_ways: bool = False,
        low_latency: bool = False,
        control: bool = True,
    ) -> None:
        self._scene = scene
        self._target = target
        self._stop = Event()
        self._ended = Event()
        self._error: BaseException | None = None
        self._levels = GatewayLevels(scene.sensor, scene.injections, scene.faults, scene.seed)
        self._link: CanLink | VideoLink
        if scene.sensor.type == "radar":
            from node.gateway_bus import CanLink

            self._link = CanLink(
                scene,
                self._levels,
                target,
                self._stop,
                both_ways=both_ways,
                low_latency=low_latency,
            )
        else:
            from node.gateway_video import VideoLink

            for flag, given in (("--both-ways", both_ways), ("--low-latency", low_latency)):
                if given:
                    raise InputError(flag, "is for CAN", "leave it out for a camera")
            self._link = VideoLink(scene, self._levels, target, self._stop)
        self._control: ControlServer | None = None
        if control:
            try:
                self._control = ControlServer(scene.sensor.name, self.set)
            except BaseException:
                self._link.close()
                raise
        self._thread = Thread(target=self._run, name=f"murk-gateway-{scene.sensor.name}")
        self._thread.daemon = True

    def start(self) -> None:
        """Begin to pass frames on."""
        self._thread.start()

    def set(self, kind: str, level: float) -> None:
        """Set the level of an injection or the rate of a fault (%), from the next message on.

        Raises
        ------
        SceneError
            If the sensor has no such kind, or the level is outside 0–100 %.
        """
        self._levels.set_level(kind, level)

    def wait(self, timeout_s: float) -> bool:
        """Wait for the end of the input or the duration; tell whether it has come."""
        return self._ended.wait(timeout_s)

    def stop(self) -> None:
        """End: the scan in flight is finished, then input and output are closed.

        Raises
        ------
        MurkError
            If the run had failed.
        """
        self._stop.set()
        self._link.interrupt()
        if self._control is not None:
            self._control.close()
        if self._thread.ident is None:
            self._link.close()
        else:
            self._thread.join(CLOSE_S)
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def summary(self) -> dict[str, Any]:
        """Return what was counted so far, for JSON."""
        sensor = self._scene.sensor
        names = {"sensor": sensor.name, "input": sensor.source, "output": self._target}
        return names | self._link.summary()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def _run(self) -> None:
        try:
            self._link.run()
        except BaseException as error:
            self._error = error
        finally:
            self._ended.set()
