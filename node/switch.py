"""The switch: a detector's models, of which the noise levels choose the one that answers."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from sys import maxsize
from threading import Thread
from time import monotonic_ns, perf_counter
from typing import Any, Generic, TypeVar

from dbc.errors import SceneError
from models.estimate.level import NoiseLevel
from node.bus.in_process import Bus
from node.chooser import Chooser
from node.events import MODEL_TOPIC, ModelChoice
from node.plan import Plan
from node.subscribe import BusLevels
from node.switch_rules import Switch

Model = TypeVar("Model")
JOIN_S = 2.0


class ModelSwitch(Generic[Model]):
    """Models of which the noise levels choose one; all are built, and warm, before the first level.

    So no change waits for weights to load, and a model that cannot be built is found before the
    drive and not in the tunnel.

    Parameters
    ----------
    rules:
        Which model when; a scene's, or built in code.
    models:
        What builds each model, by the name that the rules give it: called once, here. It should
        return a model that has answered once already where the first answer takes long.
    on_change:
        Called with every choice.

    Attributes
    ----------
    warm_up_s:
        How long building each model took, seconds.

    Raises
    ------
    SceneError
        If the rules name a model that is not among ``models``.
    """

    def __init__(
        self,
        rules: Switch,
        models: Mapping[str, Callable[[], Model]],
        on_change: Callable[[ModelChoice], None] | None = None,
    ) -> None:
        missing = [name for name in rules.models if name not in models]
        if missing:
            what = f"chooses '{missing[0]}', which is not registered"
            raise SceneError(f"switch {rules.name}", what, f"registered: {', '.join(models)}")
        self._chooser = Chooser(rules)
        self._on_change = on_change
        self._models: dict[str, Model] = {}
        self.warm_up_s: dict[str, float] = {}
        for name in rules.models:
            start_s = perf_counter()
            self._models[name] = models[name]()
            self.warm_up_s[name] = perf_counter() - start_s

    @property
    def chosen(self) -> str:
        """Name of the model that the levels ask for now; the default before the first."""
        return self._chooser.model

    @property
    def model(self) -> Model:
        """The model that the levels ask for now."""
        return self._models[self._chooser.model]

    def update(self, level: NoiseLevel | None, now_ns: int) -> ModelChoice | None:
        """Take in a level, or that none came; see ``Chooser.update``."""
        choice = self._chooser.update(level, now_ns)
        if choice is not None and self._on_change is not None:
            self._on_change(choice)
        return choice

    def follow(self, levels: Iterable[NoiseLevel | None]) -> None:
        """Take in levels as they come, until they end; for a thread beside the detector's own.

        Parameters
        ----------
        levels:
            As ``node.subscribe.subscribe`` yields them: None lets time pass.
        """
        for level in levels:
            self.update(level, monotonic_ns())


class SwitchOutput:
    """The switches of a scene: publishes what each chooses on ``/murk/model``.

    Dwell and staleness count real time. In a run as fast as possible they count the recording's:
    levels are taken in the order of time into the run, so that every run chooses alike.
    """

    def __init__(self, plan: Plan, bus: Bus) -> None:
        scene = plan.scene
        self._bus = bus
        self._choosers = [Chooser(rules) for rules in scene.switches]
        self._taken = 0
        sensors = dict.fromkeys(name for rules in scene.switches for name in rules.sensors)
        depth = maxsize if scene.clock.fast else None
        self._levels = BusLevels(bus, tuple(sensors), depth)
        timed = (
            _in_order(self._levels, sensors) if scene.clock.fast else _in_real_time(self._levels)
        )
        self._thread = Thread(target=self._run, args=(timed,), name="murk-switch", daemon=True)
        self._thread.start()

    def counts(self) -> dict[str, Any]:
        """Return ``levels`` taken in and ``dropped``, and by switch its choices and its model."""
        return {
            "levels": self._taken,
            "dropped": self._levels.dropped,
            "switches": {
                chooser.rules.name: {"choices": chooser.choices, "model": chooser.model}
                for chooser in self._choosers
            },
        }

    def close(self) -> None:
        """Take in what waits, and stop."""
        self._levels.close()
        self._thread.join(JOIN_S)

    def _run(self, timed: Iterator[tuple[NoiseLevel | None, int]]) -> None:
        for level, now_ns in timed:
            self._taken += level is not None
            for chooser in self._choosers:
                choice = chooser.update(level, now_ns)
                if choice is not None:
                    self._bus.publish(MODEL_TOPIC, choice)


def _in_real_time(
    levels: Iterable[NoiseLevel | None],
) -> Iterator[tuple[NoiseLevel | None, int]]:
    """Yield levels with the time at which they come."""
    for level in levels:
        yield level, monotonic_ns()


def _in_order(
    levels: Iterable[NoiseLevel | None], sensors: Iterable[str]
) -> Iterator[tuple[NoiseLevel | None, int]]:
    """Yield levels in the order of the time since their sensor's first, with that time.

    A level waits until each sensor has one that waits, or all have ended.
    """
    waiting: dict[str, deque[tuple[int, NoiseLevel]]] = {name: deque() for name in sensors}
    start_ns: dict[str, int] = {}
    for level in levels:
        if level is None:
            continue
        since_ns = level.stamp_ns - start_ns.setdefault(level.sensor, level.stamp_ns)
        waiting[level.sensor].append((since_ns, level))
        while all(waiting.values()):
            yield _earliest(waiting)
    while any(waiting.values()):
        yield _earliest(waiting)


def _earliest(waiting: dict[str, deque[tuple[int, NoiseLevel]]]) -> tuple[NoiseLevel, int]:
    """Take the earliest of all that wait."""
    name = min(
        (name for name in waiting if waiting[name]), key=lambda one: (waiting[one][0][0], one)
    )
    since_ns, level = waiting[name].popleft()
    return level, since_ns
