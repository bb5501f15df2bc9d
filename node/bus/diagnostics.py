"""How each sensor does, as ROS 2's diagnostics say it: OK, WARN, ERROR or STALE, debounced."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from rosbags.typesys.store import Typestore

from models.estimate.level import NoiseLevel
from node.bus.scan_message import ros_time
from node.health import SensorEvent

WARN_PERCENT = 30.0
ERROR_PERCENT = 70.0
"""Noise levels from which on a sensor is WARN and ERROR, %."""
DEBOUNCE_S = 0.5
"""A severity is published once it has lasted for so long."""
SILENT_S = 1.0
"""A sensor that gave no noise level for so long is STALE."""


class Severity(IntEnum):
    """``diagnostic_msgs/DiagnosticStatus`` levels."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Status:
    """One ``diagnostic_msgs/DiagnosticStatus``, with the same names."""

    severity: Severity
    name: str
    message: str
    hardware_id: str
    values: dict[str, str]


class SensorDiagnosis:
    """Debounced severity of one sensor. Times are of the monotonic clock, s.

    Parameters
    ----------
    name:
        Of the status, e.g. ``"murk_tunnel: front"``.
    hardware_id:
        Which device it is.
    now_s:
        When the diagnosis begins, STALE.

    Attributes
    ----------
    severity:
        The debounced one.
    """

    def __init__(self, name: str, hardware_id: str, now_s: float) -> None:
        self.severity = Severity.STALE
        self._name = name
        self._hardware_id = hardware_id
        self._level: NoiseLevel | None = None
        self._level_s = now_s
        self._event: SensorEvent | None = None
        self._candidate = Severity.STALE
        self._candidate_s = now_s

    def on_level(self, level: NoiseLevel, now_s: float) -> None:
        """Take in a noise level."""
        self._level, self._level_s = level, now_s

    def on_event(self, event: SensorEvent) -> None:
        """Take in that a live sensor speaks, or does not."""
        self._event = event

    def update(self, now_s: float) -> bool:
        """Let time pass; return whether that changed ``severity``."""
        severity, _ = self._finding(now_s)
        if severity != self._candidate:
            self._candidate, self._candidate_s = severity, now_s
        if severity == self.severity or now_s - self._candidate_s < DEBOUNCE_S:
            return False
        self.severity = severity
        return True

    def status(self, now_s: float) -> Status:
        """Return what is to be published."""
        _, message = self._finding(now_s)
        return Status(self.severity, self._name, message, self._hardware_id, self._values())

    def _finding(self, now_s: float) -> tuple[Severity, str]:
        """Return the severity at this moment, not debounced, and what is said of it."""
        if self._event is not None and self._event.state != "ok":
            lost = self._event.state == "lost"
            return Severity.ERROR if lost else Severity.STALE, self._event.detail
        level = self._level
        if level is None:
            return Severity.STALE, "no noise level yet"
        silence_s = now_s - self._level_s
        if silence_s > SILENT_S:
            return Severity.STALE, f"no noise level for {silence_s:.1f} s"
        message = f"noise level {level.level:.0f} % ± {level.std:.0f} %, {level.kind}"
        if level.level >= ERROR_PERCENT:
            return Severity.ERROR, message
        return Severity.WARN if level.level >= WARN_PERCENT else Severity.OK, message

    def _values(self) -> dict[str, str]:
        level = self._level
        if level is None:
            return {}
        return {
            "level, %": f"{level.level:.1f}",
            "standard deviation, %": f"{level.std:.1f}",
            "kind": level.kind,
            "latency, ms": f"{level.latency_ns * 1e-6:.1f}",
            "sequence": str(level.sequence),
            "dropped": str(level.dropped),
        }


def diagnostic_array(statuses: Sequence[Status], stamp_ns: int, store: Typestore) -> Any:
    """Return a ``diagnostic_msgs/DiagnosticArray``, stamped with wall time in nanoseconds."""
    types = store.types
    status_type = types["diagnostic_msgs/msg/DiagnosticStatus"]
    pair_type = types["diagnostic_msgs/msg/KeyValue"]
    return types["diagnostic_msgs/msg/DiagnosticArray"](
        types["std_msgs/msg/Header"](ros_time(stamp_ns, store), ""),
        [
            status_type(
                int(status.severity),
                status.name,
                status.message,
                status.hardware_id,
                [pair_type(key, value) for key, value in status.values.items()],
            )
            for status in statuses
        ],
    )
