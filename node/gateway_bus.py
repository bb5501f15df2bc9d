"""The gateway between two CAN buses or logs: the loop, and what happens when a bus goes down."""

from __future__ import annotations

import logging
import time
from collections import Counter
from threading import Event, Lock, Thread
from typing import Any

from dbc.errors import DeviceError, InputError
from drivers.can_bus import BusDown, CanBus, open_bus
from drivers.can_frames import CanFrames, FrameFlag
from node.gateway_can import CanGateway
from node.gateway_levels import GatewayLevels
from node.gateway_log import Clock, LogSource, LogTarget, SystemClock, is_candump
from node.gateway_scene import GatewayScene
from node.gateway_statistics import Latencies
from node.sources import is_can_bus

log = logging.getLogger("murk.gateway")

STOP_CHECK_S = 0.1
"""How long a read from a silent bus blocks at most."""
SHORT_WAIT_S = 0.002
"""A wait below this is slept: reading with a time limit is not as fine as that."""
BACK_OFF_S = 0.2
"""How long to wait before a bus that went down is tried again."""

_HEARS_ITSELF = "udp_multicast:"
"""A bus on which a node also hears what it sends itself."""


class LastingBus:
    """A CAN bus that may go down and come back; one thread may read it while another sends.

    That it went down is logged once, and that it is back.

    Parameters
    ----------
    spec, listen_only:
        As ``drivers.can_bus.open_bus`` takes them.

    Attributes
    ----------
    downs:
        Times that a read or a send found it down.
    unsent:
        Frames given up because it was down.
    """

    ended = False
    """A bus does not end."""

    def __init__(self, spec: str, *, listen_only: bool = False) -> None:
        self.downs = 0
        self.unsent = 0
        self._spec = spec
        self._listen_only = listen_only
        self._lock = Lock()
        self._is_down = False
        self._bus: CanBus | None = open_bus(spec, listen_only=listen_only)

    @property
    def dropped(self) -> int:
        """Frames that the kernel dropped since the bus was opened."""
        return self._bus.dropped if self._bus else 0

    def read(self, timeout_s: float) -> CanFrames | None:
        """Return the frames that are there, waiting for one; None where none came."""
        if timeout_s < SHORT_WAIT_S:
            time.sleep(timeout_s)
            timeout_s = 0.0
        bus = self._opened()
        if bus is None:
            return None
        try:
            frames = bus.read(timeout_s)
        except BusDown as down:
            self._lose(bus, down)
            return None
        if not len(frames):
            return None
        self._is_back()
        return frames

    def send(self, frames: CanFrames) -> bool:
        """Send frames; False, and counted, where the bus is down."""
        bus = self._opened()
        if bus is not None:
            try:
                bus.send(frames)
                self._is_back()
                return True
            except BusDown as down:
                self._lose(bus, down)
        self.unsent += len(frames)
        return False

    def close(self) -> None:
        """Close the bus."""
        if self._bus is not None:
            self._bus.close()

    def _is_back(self) -> None:
        if self._is_down:
            self._is_down = False
            log.warning("%s is back", self._spec)

    def _lose(self, bus: CanBus, down: BusDown) -> None:
        self.downs += 1
        if not self._is_down:
            self._is_down = True
            log.warning("%s", down)
        with self._lock:
            if down.gone and self._bus is bus:
                bus.close()
                self._bus = None
        time.sleep(BACK_OFF_S)

    def _opened(self) -> CanBus | None:
        """Return the bus, opened again where the interface had gone and is back."""
        with self._lock:
            if self._bus is None:
                try:
                    self._bus = open_bus(self._spec, listen_only=self._listen_only)
                except DeviceError:
                    time.sleep(BACK_OFF_S)
            return self._bus


class CanLink:
    """Runs a ``CanGateway`` from one bus or log to another.

    A log is read with its original timing, but from log to log as fast as possible.

    Parameters
    ----------
    scene:
        The radar, whose source is the bus or log to read, and what is done to it.
    levels:
        What is in force when.
    target:
        The bus to send to, or the candump log to write.
    stop:
        Ends the run.
    both_ways:
        Also send what comes from the target to the source, untouched.
    low_latency:
        Send each cluster when it comes; see ``CanGateway``.

    Raises
    ------
    DeviceError, LogError
        If a bus cannot be opened, a log not be read or written.
    InputError
        If both are the same, or one would hear the gateway itself.
    """

    def __init__(
        self,
        scene: GatewayScene,
        levels: GatewayLevels,
        target: str,
        stop: Event,
        *,
        both_ways: bool,
        low_latency: bool = False,
    ) -> None:
        source = scene.sensor.source
        if source == target:
            raise InputError(target, "is input and output", "give two of them")
        if both_ways:
            _refuse_one_way(source, target)
        self._core = CanGateway(scene.sensor, levels, scene.seed, low_latency=low_latency)
        self._duration_s = scene.duration_s
        self._both_ways = both_ways
        self._stop = stop
        self._counts: Counter[str] = Counter()
        self._latencies = Latencies()
        self._clock: Clock = SystemClock()
        self._source: LastingBus | LogSource
        if is_can_bus(source):
            self._source = LastingBus(source, listen_only=not both_ways)
        else:
            self._source = LogSource(source, fast=is_candump(target))
            self._clock = self._source.clock
        self._target: LastingBus | LogTarget
        try:
            if is_candump(target):
                self._target = LogTarget(target, self._clock)
            else:
                self._target = LastingBus(target)
        except BaseException:
            self._source.close()
            raise

    def run(self) -> None:
        """Pass frames on until the run is stopped and the scan in flight is over; then close."""
        source, target = self._source, self._target
        way_back: Thread | None = None
        if self._both_ways and isinstance(source, LastingBus) and isinstance(target, LastingBus):
            way_back = Thread(target=self._pass_back, args=(target, source), name="murk-way-back")
            way_back.daemon = True
            way_back.start()
        try:
            self._pass_on()
        finally:
            self._stop.set()
            if way_back is not None:
                way_back.join()
            self.close()

    def interrupt(self) -> None:
        """Do nothing: no read lasts longer than ``STOP_CHECK_S``."""

    def close(self) -> None:
        """Close both sides."""
        self._source.close()
        self._target.close()

    def summary(self) -> dict[str, Any]:
        """Return what was counted, for JSON."""
        passed = ("frames_in", "frames_out", "frames_back", "error_frames")
        changed = ("scans", "degraded", "incomplete", "failures", "late", "silenced", "cut_off")
        record: dict[str, Any] = {name: self._counts[name] for name in passed}
        record |= {name: self._core.counts[name] for name in changed}
        record["faults"] = dict(self._core.faults.counts)
        record["dropped"] = self._source.dropped
        record["unsent"] = self._target.unsent
        record["bus_down"] = self._source.downs + self._target.downs
        return record | self._latencies.summary()

    def _pass_on(self) -> None:
        core = self._core
        started_ns = self._clock.now_ns()
        while not (self._stop.is_set() and core.finished):
            frames = self._read(core.next_due_ns())
            now_ns = self._clock.now_ns()
            if frames is not None:
                core.feed(frames, now_ns)
            due = core.due(now_ns)
            if due is not None and self._target.send(due):
                self._counts["frames_out"] += len(due)
                self._latencies.add((self._clock.stamp_ns() - due.stamp_ns).tolist())
            over = self._duration_s is not None and now_ns - started_ns >= self._duration_s * 1e9
            if over or self._source.ended or self._stop.is_set():
                self._stop.set()
                core.finish()

    def _read(self, until_ns: int | None) -> CanFrames | None:
        """Return the frames that come before ``until_ns``, without errors that cannot be sent."""
        wait_s = STOP_CHECK_S
        if until_ns is not None:
            wait_s = min(wait_s, max(0.0, (until_ns - self._clock.now_ns()) * 1e-9))
        frames = self._source.read(wait_s)
        if frames is None:
            return None
        self._counts["frames_in"] += len(frames)
        errors = (frames.flags & FrameFlag.ERROR) != 0
        if not errors.any() or isinstance(self._target, LogTarget):
            return frames
        self._counts["error_frames"] += int(errors.sum())
        return frames.select(~errors) if not errors.all() else None

    def _pass_back(self, target: LastingBus, source: LastingBus) -> None:
        while not self._stop.is_set():
            frames = target.read(STOP_CHECK_S)
            if frames is not None and source.send(frames):
                self._counts["frames_back"] += len(frames)


def _refuse_one_way(source: str, target: str) -> None:
    """Raise ``InputError`` where frames cannot go both ways."""
    remedy = "leave --both-ways out, or give another kind of bus"
    for side in (source, target):
        if not is_can_bus(side):
            raise InputError(side, "is a log, which only goes one way", remedy)
        if side.startswith(_HEARS_ITSELF):
            raise InputError(side, "hears what it sends, so it cannot be read as well", remedy)
