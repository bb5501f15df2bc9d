"""What the page is told: the last minute of every sensor, events, models and the node's state.

Levels, events and choices are heard as they are published, for a minute of them is shown to
whoever opens the page; scans, images and the heartbeat are only looked up while somebody watches.
"""

from __future__ import annotations

from collections import deque
from threading import Lock
from time import monotonic, time_ns
from typing import Any

import numpy as np

from drivers.scan import RadarScan
from models.degrade.kinds import KINDS
from models.estimate.level import NoiseLevel
from node.bus.in_process import Bus, Subscription
from node.events import (
    EVENT_TOPIC,
    MODEL_TOPIC,
    STATE_TOPIC,
    ModelChoice,
    NodeEvent,
    NodeState,
)
from node.health import SensorEvent
from node.plan import Plan
from node.scene import Sensor

HISTORY_S = 60.0
POINT_MS = 90
"""The history takes at most one point in so long."""
RATE_S = 3.0
"""The span of the published rate."""
STATISTICS_S = 0.5
"""Latency percentiles are computed anew after so long."""
ARRIVALS_KEPT = 4096
EVENTS_KEPT = 100
OVERLAP_MS = 200
"""What was taken in just as the last snapshot was made is sent again; the page sees to it."""
QUEUE_DEPTH = 64


class SensorFeed:
    """Levels of one sensor. Times are ms since the feed began."""

    def __init__(self, sensor: Sensor) -> None:
        self.sensor = sensor
        self.scan: RadarScan | None = None
        self._health: str | None = None
        self._newest: NoiseLevel | None = None
        self._newest_ms = 0
        self._history: deque[tuple[int, float, float, float | None]] = deque()
        self._arrivals: deque[tuple[float, int]] = deque(maxlen=ARRIVALS_KEPT)
        self._percentiles_ms: tuple[float, float] | None = None
        self._computed_s = 0.0
        self._lock = Lock()

    def take(self, level: NoiseLevel, now_ms: int) -> None:
        """Take in a published level."""
        with self._lock:
            self._newest, self._newest_ms = level, now_ms
            self._arrivals.append((now_ms * 1e-3, level.latency_ns))
            _forget(self._arrivals, now_ms * 1e-3 - HISTORY_S)
            if self._history and now_ms < self._history[-1][0] + POINT_MS:
                return
            injected = None if level.injected is None else round(level.true_level, 1)
            self._history.append((now_ms, round(level.level, 1), round(level.std, 1), injected))
            _forget(self._history, now_ms - HISTORY_S * 1e3)

    def take_event(self, event: SensorEvent) -> None:
        """Take in what became of the sensor."""
        self._health = event.state

    def state(self, now_ms: int, since_ms: int) -> dict[str, Any]:
        """Return its newest values, and the points of its history after ``since_ms``."""
        with self._lock:
            newest = self._newest
            points = [point for point in reversed(self._history) if point[0] > since_ms][::-1]
            record: dict[str, Any] = {"health": self._health, "points": points}
            if newest is None:
                return record
            record |= self._statistics(now_ms * 1e-3)
            record["t"] = self._newest_ms
        return record | {
            "level": round(newest.level, 1),
            "std": round(newest.std, 1),
            "raw": round(newest.raw, 1),
            "kind": newest.kind,
            "kinds": {kind: round(p, 3) for kind, p in newest.kind_probabilities.items()},
            "injected": newest.injected,
            "sequence": newest.sequence,
            "dropped": newest.dropped,
        }

    def _statistics(self, now_s: float) -> dict[str, float | None]:
        """Return the rate of the last seconds, and latency percentiles of the last minute."""
        if self._percentiles_ms is None or now_s > self._computed_s + STATISTICS_S:
            p50, p99 = np.percentile([latency for _, latency in self._arrivals], [50, 99]) * 1e-6
            self._percentiles_ms, self._computed_s = (round(p50, 2), round(p99, 2)), now_s
        recent = [at for at, _ in self._arrivals if at > now_s - RATE_S]
        span = recent[-1] - recent[0] if len(recent) > 1 else 0.0
        rate = round((len(recent) - 1) / span, 1) if span > 0 else None
        p50, p99 = self._percentiles_ms
        return {"rate": rate, "p50": p50, "p99": p99}


def _forget(history: deque[Any], before: float) -> None:
    while history[0][0] < before:
        history.popleft()


class Feed:
    """All that the page shows, gathered from a bus.

    Parameters
    ----------
    plan:
        Says which sensors there are, and which take injections.
    bus:
        Where to listen.
    """

    def __init__(self, plan: Plan, bus: Bus) -> None:
        self._bus = bus
        self._start_s = monotonic()
        sources = {one.sensor: one.reason for one in plan.stages if one.name == "source"}
        self._scene = {
            "name": plan.scene.name,
            "sensors": [
                {
                    "name": sensor.name,
                    "type": sensor.type,
                    "source": sources[sensor.name],
                    "kinds": KINDS[sensor.type] if plan.keeps("inject", sensor.name) else [],
                }
                for sensor in plan.scene.sensors
            ],
        }
        self.sensors = [SensorFeed(sensor) for sensor in plan.scene.sensors]
        self._events: deque[dict[str, Any]] = deque(maxlen=EVENTS_KEPT)
        self._event_count = 0
        self._models: dict[str, dict[str, Any]] = {}
        self._lock = Lock()
        self._subscriptions = list(self._subscribe())

    def _subscribe(self) -> list[Subscription]:
        wanted: list[tuple[str, Any]] = [
            (EVENT_TOPIC, self._take_node_event),
            (MODEL_TOPIC, self._take_choice),
        ]
        for feed in self.sensors:
            topic = f"/murk/{feed.sensor.name}"
            wanted.append((f"{topic}/noise_level", self._taker(feed)))
            wanted.append((f"{topic}/event", self._event_taker(feed)))
        return [self._bus.subscribe(topic, take, depth=QUEUE_DEPTH) for topic, take in wanted]

    def _taker(self, feed: SensorFeed) -> Any:
        return lambda level: feed.take(level, self.now_ms())

    def _event_taker(self, feed: SensorFeed) -> Any:
        def take(event: SensorEvent) -> None:
            feed.take_event(event)
            self._log(event.stamp_ns, event.sensor, event.state, event.detail)

        return take

    def _take_node_event(self, event: NodeEvent) -> None:
        self._log(event.stamp_ns, event.source, "trouble", event.detail)

    def _take_choice(self, choice: ModelChoice) -> None:
        with self._lock:
            self._models[choice.switch] = {
                "model": choice.model,
                "previous": choice.previous,
                "reason": choice.reason,
                "stamp": time_ns() // 1_000_000,
            }
        title = f"{choice.switch} → {choice.model}"
        self._log(time_ns(), title, "model", choice.reason)

    def _log(self, stamp_ns: int, source: str, state: str, text: str) -> None:
        with self._lock:
            self._event_count += 1
            self._events.append(
                {
                    "id": self._event_count,
                    "stamp": stamp_ns // 1_000_000,
                    "source": source,
                    "state": state,
                    "text": text,
                }
            )

    def now_ms(self) -> int:
        """Return the time since the feed began."""
        return round((monotonic() - self._start_s) * 1e3)

    def full(self, tick: int) -> dict[str, Any]:
        """Return everything, for who has just come or has missed something."""
        return {
            **self._state("full", tick, since_ms=-1, since_event=0, all_scans=True),
            "scene": self._scene,
        }

    def update(self, tick: int, since_ms: int, since_event: int) -> dict[str, Any]:
        """Return the newest values, and what has come after a time and an event."""
        return self._state("update", tick, since_ms - OVERLAP_MS, since_event, all_scans=False)

    def _state(
        self, kind: str, tick: int, since_ms: int, since_event: int, *, all_scans: bool
    ) -> dict[str, Any]:
        now_ms = self.now_ms()
        sensors = {}
        for feed in self.sensors:
            sensors[feed.sensor.name] = record = feed.state(now_ms, since_ms)
            scan = self._bus.latest(f"/murk/{feed.sensor.name}/scan")
            if scan is not None and (all_scans or scan is not feed.scan):
                record["scan"] = _points(scan)
            if not all_scans:
                feed.scan = scan
        with self._lock:
            events = [event for event in self._events if event["id"] > since_event]
            models = dict(self._models)
        return {
            "type": kind,
            "tick": tick,
            "now": now_ms,
            "sensors": sensors,
            "events": events,
            "models": models,
            "node": self._node(),
        }

    def _node(self) -> dict[str, Any] | None:
        state: NodeState | None = self._bus.latest(STATE_TOPIC)
        if state is None:
            return None
        age_ms = max(0, time_ns() - state.stamp_ns) // 1_000_000
        return {"state": state.state, "sequence": state.sequence, "age": age_ms}

    @property
    def last_event(self) -> int:
        """Number of the newest event."""
        return self._event_count

    @property
    def dropped(self) -> int:
        """Messages that came faster than they could be taken in."""
        return sum(subscription.dropped for subscription in self._subscriptions)

    def close(self) -> None:
        """Stop listening."""
        for subscription in self._subscriptions:
            subscription.close()


def _points(scan: RadarScan) -> dict[str, list[int]]:
    """Return the columns that are drawn, in dm, dm/s and dBm²."""
    columns = {"x": 10, "y": 10, "vx": 10, "vy": 10, "rcs": 1}
    return {
        name: np.rint(np.nan_to_num(getattr(scan, name)) * factor).astype(int).tolist()
        for name, factor in columns.items()
    }
