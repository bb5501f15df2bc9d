"""``/diagnostics``: once a second, and as soon as a sensor's severity changes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

from models.estimate.level import NoiseLevel
from node.bus.dds import RELIABLE, RosParticipant
from node.bus.diagnostics import SensorDiagnosis, Severity, Status, diagnostic_array
from node.bus.messages import serialize, typestore
from node.bus.ros2_publication import Publication
from node.health import SensorEvent
from node.scene import Sensor

TOPIC = "/diagnostics"
"""Where ROS 2's aggregators listen, whatever the namespace."""
PERIOD_S = 1.0


class DiagnosticsPublisher:
    """Publishes a status of the node itself and one a sensor.

    Parameters
    ----------
    node:
        The node's full name in ROS.
    rivals:
        Returns the topics that another node publishes as well, which is worth a warning.
    """

    def __init__(
        self,
        participant: RosParticipant,
        node: str,
        sensors: Sequence[Sensor],
        rivals: Callable[[], list[str]],
    ) -> None:
        now_s = time.monotonic()
        self._node = node.strip("/")
        self._rivals = rivals
        self._sensors: Mapping[str, SensorDiagnosis] = {
            sensor.name: SensorDiagnosis(
                f"{self._node}: {sensor.name}", _hardware_id(sensor), now_s
            )
            for sensor in sensors
        }
        self._published_s = float("-inf")
        store = typestore()
        self.publication = Publication(
            participant,
            TOPIC,
            "diagnostic_msgs/msg/DiagnosticArray",
            RELIABLE,
            lambda statuses: serialize(diagnostic_array(statuses, time.time_ns(), store), store),
        )

    def take(self, message: object) -> None:
        """Take in a noise level or what is said of a sensor; anything else says nothing."""
        if isinstance(message, NoiseLevel):
            self._sensors[message.sensor].on_level(message, time.monotonic())
        elif isinstance(message, SensorEvent):
            self._sensors[message.sensor].on_event(message)

    def poll(self) -> None:
        """Publish if it is time to."""
        now_s = time.monotonic()
        changed = [sensor.update(now_s) for sensor in self._sensors.values()]
        if any(changed) or now_s - self._published_s >= PERIOD_S:
            self._published_s = now_s
            statuses = [sensor.status(now_s) for sensor in self._sensors.values()]
            self.publication.send([self._own_status(), *statuses])

    def _own_status(self) -> Status:
        rivals = self._rivals()
        severity = Severity.WARN if rivals else Severity.OK
        message = f"another node publishes {', '.join(rivals)}" if rivals else "runs"
        return Status(severity, f"{self._node}: node", message, "", {})


def _hardware_id(sensor: Sensor) -> str:
    if sensor.type == "radar":
        return f"{sensor.source} SensorID {sensor.sensor_id}"
    return sensor.source
