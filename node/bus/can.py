"""Noise levels on a CAN bus, so that an ECU can listen: ``dbc/noise_level.dbc``."""

from __future__ import annotations

import time
from dataclasses import replace
from threading import Event, Lock, Thread
from typing import Any

from dbc.errors import MurkError, SceneError
from drivers.can_bus import CanBus, open_bus
from models.estimate.level import NoiseLevel
from node.bus.can_levels import COUNTS, MOST_SENSORS, OLDEST_MS, CanLevel, encode_level
from node.bus.in_process import Bus, Subscription
from node.events import EVENT_TOPIC, NodeEvent
from node.health import SensorEvent
from node.plan import Plan

CYCLE_S = 0.1
"""A sensor's frame is sent again after so long without a new level (``GenMsgCycleTime``)."""
JOIN_S = 2.0


class CanOutput:
    """Sends each sensor's level as it is published, and again every 100 ms while none comes.

    A bus that is down costs the frames, which are counted; the node goes on.

    Raises
    ------
    DeviceError
        If the bus cannot be opened.
    SceneError
        If there are more sensors than identifiers.
    """

    def __init__(self, plan: Plan, bus: Bus) -> None:
        settings = plan.scene.outputs.can
        assert settings is not None, "plan() keeps this output where the scene asks for it"
        sensors = plan.scene.sensors
        if len(sensors) > MOST_SENSORS or settings.first_id + len(sensors) > 0x800:
            what = f"{len(sensors)} sensors from ID 0x{settings.first_id:X} on"
            expected = f"up to {MOST_SENSORS} sensors, below ID 0x800"
            raise SceneError("outputs.can", what, expected)
        self._node = bus
        self._can: CanBus = open_bus(settings.bus, ids=())
        self._lock = Lock()
        self._stop = Event()
        self._sent = 0
        self._failed = 0
        self._last: dict[str, CanLevel] = {}
        self._arrival_s: dict[str, float] = {}
        self._due_s: dict[str, float] = {}
        self._subscriptions: list[Subscription] = []
        for number, sensor in enumerate(sensors):
            self._last[sensor.name] = CanLevel(
                can_id=settings.first_id + number,
                stamp_ns=0,
                sensor_type=sensor.type,
                state="never_seen",
                level=0.0,
                std=0.0,
                kind="unknown",
                kind_probability=0.0,
                age_ms=OLDEST_MS,
                counter=COUNTS - 1,
            )
            self._due_s[sensor.name] = 0.0
            self._subscriptions += [
                bus.subscribe(f"/murk/{sensor.name}/noise_level", self._on_level),
                bus.subscribe(f"/murk/{sensor.name}/event", self._on_event),
            ]
        self._cycle = Thread(target=self._repeat, name="murk-can", daemon=True)
        self._cycle.start()

    def counts(self) -> dict[str, Any]:
        """Return ``sent`` and ``failed`` frames, and levels ``dropped`` before they were sent."""
        dropped = sum(subscription.dropped for subscription in self._subscriptions)
        return {"sent": self._sent, "failed": self._failed, "dropped": dropped}

    def close(self) -> None:
        """Send what is queued, then fall silent, which tells a listener that the node has gone."""
        for subscription in self._subscriptions:
            subscription.close()
        for subscription in self._subscriptions:
            subscription.join(JOIN_S)
        self._stop.set()
        self._cycle.join(JOIN_S)
        with self._lock:
            self._can.close()

    def _on_level(self, level: NoiseLevel) -> None:
        with self._lock:
            self._arrival_s[level.sensor] = time.monotonic() - level.latency_ns * 1e-9
            self._last[level.sensor] = replace(
                self._last[level.sensor],
                state="ok",
                level=level.level,
                std=level.std,
                kind=level.kind,
                kind_probability=level.kind_probabilities[level.kind],
            )
            self._send(level.sensor)

    def _on_event(self, event: SensorEvent) -> None:
        with self._lock:
            self._last[event.sensor] = replace(self._last[event.sensor], state=event.state)
            self._send(event.sensor)

    def _repeat(self) -> None:
        while not self._stop.wait(CYCLE_S / 4):
            with self._lock:
                now_s = time.monotonic()
                for sensor, due_s in self._due_s.items():
                    if now_s >= due_s:
                        self._send(sensor)

    def _send(self, sensor: str) -> None:
        """Send a sensor's frame; the lock is held."""
        if self._stop.is_set():
            return
        now_s = time.monotonic()
        last = self._last[sensor]
        age_ms = OLDEST_MS
        if sensor in self._arrival_s:
            age_ms = min(OLDEST_MS, round(1e3 * max(0.0, now_s - self._arrival_s[sensor])))
        last = replace(last, age_ms=age_ms, counter=(last.counter + 1) % COUNTS)
        self._last[sensor] = last
        self._due_s[sensor] = now_s + CYCLE_S
        try:
            self._can.send(encode_level(last))
        except MurkError as error:
            self._failed += 1
            if self._failed == 1:
                event = NodeEvent("can", time.time_ns(), f"levels are not sent: {error}")
                self._node.publish(EVENT_TOPIC, event)
        else:
            self._sent += 1
