"""The pipeline: source → queue → inject → estimate → publish, one worker a sensor."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from threading import Event
from time import monotonic
from typing import TYPE_CHECKING, Any

from dbc.errors import SceneError
from models.estimate.level import NoiseLevel
from node.bus.in_process import Bus
from node.lane import Lane, Result
from node.lifecycle import Lifecycle
from node.mailbox import Mailbox
from node.plan import Plan
from node.sources import open_source

if TYPE_CHECKING:
    from models.world.road import World

RESULT_DEPTH = 256
STOP_CHECK_S = 0.1
JOIN_S = 5.0
WORLD_DURATION_S = 20.0
"""How long the simulated world lasts where the scene does not say."""


class Pipeline:
    """Runs a plan.

    Parameters
    ----------
    plan:
        What to run.
    bus:
        Where to publish: ``/murk/<sensor>/noise_level``, ``scan`` or ``image`` (as degraded),
        ``radar_state``, ``motion_input`` and ``event`` (of a live sensor); and the node's own
        ``/murk/node/state``.

    Attributes
    ----------
    plan:
        What it runs.

    Raises
    ------
    InputError
        If a source or a network cannot be opened.
    """

    def __init__(self, plan: Plan, bus: Bus) -> None:
        self.plan = plan
        self._stop = Event()
        self._results: Mailbox[Result] = Mailbox(RESULT_DEPTH, lossless=plan.scene.clock.fast)
        self._wall_time_s = 0.0
        self._lanes: dict[str, Lane] = {}
        world = _world(plan) if plan.keeps("world") else None
        self._lifecycle = Lifecycle(plan.scene.name, bus)
        try:
            for sensor in plan.scene.sensors:
                self._lanes[sensor.name] = Lane(plan, sensor, open_source(sensor, world), bus)
        except BaseException:
            self.close()
            raise
        self._lifecycle.enter("inactive")

    def run(self) -> Iterator[NoiseLevel]:
        """Yield every noise level until all sources have ended or ``stop`` is called.

        As fast as possible, the order is by time into the run, then by sensor, so that two runs
        yield the same; otherwise it is the order of publication.

        Raises
        ------
        MurkError
            At the end, if a source failed; what it gave before has been yielded.
        """
        started_s = monotonic()
        threads = [
            thread
            for lane in self._lanes.values()
            for thread in lane.threads(self._stop, self._results)
        ]
        for thread in threads:
            thread.start()
        self.activate()
        try:
            if self.plan.scene.clock.fast:
                yield from self._in_order(self._arriving())
            else:
                yield from (one.level for one in self._arriving() if one.level is not None)
        finally:
            self.stop()
            self._close_live_sources()
            self._results.close()
            for thread in threads:
                thread.join(JOIN_S)
            self._lifecycle.close()
            self._wall_time_s = monotonic() - started_s
        for lane in self._lanes.values():
            if lane.error is not None:
                raise lane.error

    def activate(self) -> None:
        """Estimate and publish from now on, as ``run`` does from its start."""
        for lane in self._lanes.values():
            lane.active = True
        self._lifecycle.enter("active")

    def deactivate(self) -> None:
        """Read the sensors on, and leave what comes from them aside until ``activate``."""
        for lane in self._lanes.values():
            lane.active = False
        self._lifecycle.enter("inactive")

    def close(self) -> None:
        """Release what a pipeline holds that was never run; ``run`` does it by itself."""
        for lane in self._lanes.values():
            lane.source.close()
        self._lifecycle.close()

    def stop(self) -> None:
        """Ask the run to end; what is queued is still estimated. Safe in a signal handler."""
        self._stop.set()

    def set_injection(self, sensor: str, kind: str, level: float | None) -> None:
        """Change what is injected while running; see ``Injector.set_level``.

        Raises
        ------
        SceneError
            If there is no such sensor, the scene injects nothing into it, or kind or level are
            impossible.
        """
        lane = self._lanes.get(sensor)
        if lane is None:
            raise SceneError(sensor, "is no sensor of this run", f"it has {', '.join(self._lanes)}")
        if lane.injector is None:
            raise SceneError(sensor, "has no injector", "add an injection of level 0 to the scene")
        lane.injector.set_level(kind, level)

    def summary(self) -> dict[str, Any]:
        """Return what was counted, by sensor, for JSON."""
        sensors = {name: lane.statistics.summary() for name, lane in self._lanes.items()}
        return {
            "scene": self.plan.scene.name,
            "wall_time_s": round(self._wall_time_s, 3),
            "results_dropped": self._results.dropped,
            "sensors": sensors,
        }

    def _arriving(self) -> Iterator[Result]:
        """Yield results as they come, until every lane has said that it ended."""
        running = len(self._lanes)
        while running:
            if self._stop.is_set():
                self._close_live_sources()
            for lane in self._lanes.values():
                lane.check_health()
            try:
                result = self._results.get(STOP_CHECK_S)
            except TimeoutError:
                if all(lane.ended for lane in self._lanes.values()):
                    return  # an end made room for newer results
                continue
            running -= result.level is None
            yield result

    def _in_order(self, results: Iterator[Result]) -> Iterator[NoiseLevel]:
        """Merge the lanes by time: the earliest goes out once every running lane has one."""
        waiting: dict[str, deque[Result]] = {name: deque() for name in self._lanes}
        for result in results:
            waiting[result.sensor].append(result)
            while waiting and all(waiting.values()):
                name = min(waiting, key=lambda name: (waiting[name][0].t_ns, name))
                level = waiting[name].popleft().level
                if level is None:
                    del waiting[name]
                else:
                    yield level

    def _close_live_sources(self) -> None:
        """Wake readers that wait for a sensor; a recording is closed by its reader."""
        for lane in self._lanes.values():
            if lane.source.live:
                lane.source.close()


def _world(plan: Plan) -> World:
    from models.world.road import World

    scene = plan.scene
    return World(seed=scene.seed, duration_s=scene.duration_s or WORLD_DURATION_S)
