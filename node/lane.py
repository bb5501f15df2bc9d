"""One sensor's way through the pipeline: a thread that reads, and a thread that works."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from threading import Event, Thread
from time import monotonic, monotonic_ns, thread_time
from typing import Any, NamedTuple

from dbc.errors import InputError, MurkError
from drivers.frame import Frame
from drivers.scan import MotionInput, RadarScan, RadarState
from models.estimate.level import NoiseLevel
from node.bus.in_process import Bus
from node.estimator import Estimator
from node.health import Health, SensorEvent
from node.injector import Injector
from node.live_sources import Lost
from node.mailbox import Closed, Mailbox
from node.pace import Pace
from node.plan import Plan
from node.scene import Sensor
from node.sources import Message, Source
from node.statistics import SensorStatistics

log = logging.getLogger("murk.lane")

QUEUE_DEPTH = 5
"""Messages that wait for the worker at most, as ROS 2's sensor-data QoS keeps."""


class Arrived(NamedTuple):
    """A message with its history: when it reached the node, and how far into the run that is."""

    message: Frame | RadarScan
    arrival_ns: int
    t_ns: int


class Result(NamedTuple):
    """What a worker hands over: a noise level, or None at the end of its sensor."""

    sensor: str
    t_ns: int
    level: NoiseLevel | None


class Lane:
    """Source, queue, injector and estimator of one sensor.

    Attributes
    ----------
    statistics:
        What was counted so far.
    error:
        Why reading ended, where it did not end well.
    injector:
        None where the scene injects nothing into this sensor.
    health:
        Whether the sensor speaks.
    ended:
        Whether the worker has handed over its last result.
    active:
        Whether what comes is estimated; while it is not, it is read and left aside.
    """

    def __init__(self, plan: Plan, sensor: Sensor, source: Source, bus: Bus) -> None:
        scene = plan.scene
        self.source = source
        self.statistics = SensorStatistics()
        self.error: MurkError | None = None
        self.health = Health(sensor.name, monotonic())
        self.ended = False
        self.active = True
        self.injector: Injector | None = None
        if plan.keeps("inject", sensor.name):
            wanted = (one for one in scene.injections if one.sensor == sensor.name)
            self.injector = Injector(sensor, wanted, scene.seed)
        self._sensor = sensor
        self._clock = scene.clock
        self._duration_ns = None if scene.duration_s is None else round(scene.duration_s * 1e9)
        self._estimator = Estimator(sensor.type, sensor.calibration, adaptive=sensor.adaptive)
        self._bus = bus
        lossless = scene.clock.fast and not source.live
        self._queue: Mailbox[Arrived] = Mailbox(QUEUE_DEPTH, lossless=lossless)

    def threads(self, stop: Event, results: Mailbox[Result]) -> list[Thread]:
        """Return the lane's two threads, not yet started."""
        name = self._sensor.name
        return [
            Thread(target=self._read, args=(stop,), name=f"murk-read-{name}", daemon=True),
            Thread(target=self._work, args=(results,), name=f"murk-work-{name}", daemon=True),
        ]

    def _read(self, stop: Event) -> None:
        try:
            self._queue_messages(stop)
        except MurkError as error:
            self.error = error
        except Exception as error:
            log.exception("reading %s failed", self._sensor.name)
            self.error = MurkError(f"{self._sensor.source}: {error}")
        finally:
            self.statistics.reading_cpu_s = thread_time()
            self.source.close()
            self._queue.close()

    def _queue_messages(self, stop: Event) -> None:
        """Read the source, keep its pace, and queue what the worker shall estimate."""
        objects_only = False
        live = self.source.live
        pace = Pace(None if self._clock.fast or live else self._clock.speed, live=live)
        for message in _looped(self.source, self._clock.loop and not self.source.live):
            if stop.is_set():
                return
            if isinstance(message, Lost):
                self._tell(self.health.lost(message.detail))
                continue
            if not isinstance(message, Frame | RadarScan):
                topic = "motion_input" if isinstance(message, MotionInput) else "radar_state"
                if isinstance(message, RadarState) and self.injector is not None:
                    message = self.injector.mark(message)
                self._publish(topic, message)
                continue
            if isinstance(message, RadarScan) and message.mode == "object":
                objects_only = not self.statistics.received
                continue
            t_ns = pace.since_start_ns(message.stamp_ns)
            over = self._duration_ns is not None and t_ns >= self._duration_ns
            if over or pace.stopped_before(t_ns, stop):
                return
            self._tell(self.health.seen(monotonic(), message.stamp_ns))
            self.statistics.receive(message)
            if not self.active:
                self.statistics.left_aside += 1
                continue
            self._queue.put(Arrived(message, monotonic_ns(), t_ns))
        if not self.statistics.received and not stop.is_set():
            raise self._nothing(objects_only)

    def check_health(self) -> None:
        """Publish it where a live sensor has fallen silent, or has not spoken at all."""
        if self.source.live and not self.ended:
            self._tell(self.health.check(monotonic()))

    def _tell(self, event: SensorEvent | None) -> None:
        if event is None or not self.source.live:
            return
        self.statistics.events[event.state] = self.statistics.events.get(event.state, 0) + 1
        level = logging.INFO if event.state == "ok" else logging.WARNING
        log.log(level, "%s is %s: %s", event.sensor, event.state.replace("_", " "), event.detail)
        self._publish("event", event)

    def _nothing(self, objects_only: bool) -> InputError:
        if self._sensor.type == "camera":
            return InputError(self._sensor.source, "holds no frame", "expected a video or images")
        if objects_only:
            expected = "the noise level needs clusters: set the radar's OutputType to clusters"
            return InputError(self._sensor.source, "holds objects, no clusters", expected)
        what = f"holds no cluster scan of SensorID {self._sensor.sensor_id}"
        return InputError(self._sensor.source, what, "expected CAN IDs 0x600, 0x701 (+ 0x10 × ID)")

    def _work(self, results: Mailbox[Result]) -> None:
        """Inject, estimate and publish until the reader is done; a bad message is counted."""
        while True:
            try:
                arrived = self._queue.get()
            except Closed:
                break
            try:
                level = self._process(arrived)
            except Exception:
                self.statistics.failures += 1
                if self.statistics.failures == 1:
                    log.exception("a message of %s failed; more are counted", self._sensor.name)
            else:
                results.put(Result(self._sensor.name, arrived.t_ns, level))
        self.statistics.working_cpu_s = thread_time()
        results.put(Result(self._sensor.name, 0, None))
        self.ended = True

    def _process(self, arrived: Arrived) -> NoiseLevel:
        self.statistics.dropped_by_queue = self._queue.dropped
        message: Frame | RadarScan = arrived.message
        injected, drawn = dict(message.injected or {}), dict(message.drawn or {})
        if self.injector is not None:
            message, added = self.injector.inject(message, arrived.t_ns * 1e-9)
            for kind, one in added.items():
                injected.pop(kind, None)
                drawn.pop(kind, None)
                injected[kind], drawn[kind] = one.level, one
        self._publish("image" if isinstance(message, Frame) else "scan", message)
        level = self._estimator.estimate(
            message,
            arrival_ns=arrived.arrival_ns,
            injected=injected or None,
            dropped=self.statistics.dropped,
        )
        if drawn:
            level = replace(level, drawn=drawn)
        self.statistics.count(level)
        self._publish("noise_level", level)
        return level

    def _publish(self, topic: str, message: Any) -> None:
        self._bus.publish(f"/murk/{self._sensor.name}/{topic}", message)


def _looped(source: Source, loop: bool) -> Iterator[Message | Lost]:
    """Yield a source's messages; with ``loop`` again and again, stamps and sequence going on."""
    shift: dict[str, int] = {}
    while True:
        first: Frame | RadarScan | None = None
        last: Frame | RadarScan | None = None
        count = 0
        for original in source.messages():
            message = original
            if shift and not isinstance(original, Lost):
                message = _moved(original, shift)
            if isinstance(message, Frame | RadarScan):
                first, last, count = first or message, message, count + 1
            yield message
        if not loop or first is None or last is None:
            return
        period_ns = (last.stamp_ns - first.stamp_ns) // max(1, count - 1)
        shift = {
            "stamp_ns": shift.get("stamp_ns", 0) + last.stamp_ns - first.stamp_ns + period_ns,
            "sequence": last.sequence + 1,
            "dropped": last.dropped,
        }


def _moved(message: Message, shift: dict[str, int]) -> Message:
    names = (name for name in shift if hasattr(message, name))
    return replace(message, **{name: getattr(message, name) + shift[name] for name in names})
