"""Fault injection into one sensor's messages, by schedule or by a call while running."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from threading import Lock
from typing import Any

from dbc.errors import SceneError
from drivers.frame import Frame
from drivers.scan import RadarState
from models.degrade.draw import DrawKey
from models.degrade.kinds import KINDS, module_of
from node.scene import Injection, Sensor


class Injector:
    """Degrades the messages of one sensor.

    Parameters
    ----------
    sensor:
        The sensor whose messages will come.
    injections:
        The scene's injections into this sensor, applied in this order.
    seed:
        The run's seed: the same seed degrades the same message in the same way.
    """

    def __init__(self, sensor: Sensor, injections: Iterable[Injection], seed: int) -> None:
        injections = tuple(injections)
        self._sensor = sensor
        self._schedule = {injection.kind: injection.schedule(seed) for injection in injections}
        self._options = {injection.kind: injection.options for injection in injections}
        self._seed = seed
        self._set: dict[str, float] = {}
        self._burst: Any = None
        """The jammer whose burst the radar has not told of yet."""
        self._lock = Lock()

    def set_level(self, kind: str, level: float | None) -> None:
        """Override the schedule of one kind from now on; None gives it back to the schedule.

        Raises
        ------
        SceneError
            If the sensor has no such kind, or the level is outside 0–100 %.
        """
        kinds = KINDS[self._sensor.type]
        if kind not in kinds:
            expected = f"a {self._sensor.type} has {', '.join(kinds)}"
            raise SceneError(self._sensor.name, f"has no kind '{kind}'", expected)
        if level is not None and not 0 <= level <= 100:
            raise SceneError(f"{self._sensor.name}:{kind}", f"level {level}", "expected 0 to 100")
        with self._lock:
            if level is None:
                self._set.pop(kind, None)
            else:
                self._set[kind] = level

    def levels_at(self, t_s: float) -> dict[str, float]:
        """Return the levels (%) above 0 in force ``t_s`` seconds after the first message."""
        levels = {kind: schedule.level_at(t_s) for kind, schedule in self._schedule.items()}
        with self._lock:
            levels |= self._set
        return {kind: level for kind, level in levels.items() if level > 0}

    def draw(self, kind: str, level: float, sequence: int) -> Any:
        """Return the drawn parameters of a kind at a message, with the scene's options."""
        key = DrawKey(self._seed, self._sensor.name, sequence)
        options = self._options.get(kind, {})
        return module_of(self._sensor.type, kind).draw(kind, level, key, **options)

    def mark(self, state: RadarState) -> RadarState:
        """Return the radar's state, with its interference bit if a burst came since the last."""
        burst = self.take_burst()
        if burst is None:
            return state
        marked: RadarState = module_of("radar", "interference").marked(burst, state)
        return marked

    def take_burst(self) -> Any:
        """Return the jammer whose burst came since the last call; None where none did."""
        burst, self._burst = self._burst, None
        return burst

    def inject(self, message: Any, t_s: float) -> tuple[Any, dict[str, Any]]:
        """Degrade a Frame or a RadarScan.

        Returns
        -------
        The message, and the drawn parameters of what was injected by kind, in the order in which
        they were applied; none where nothing was.
        """
        levels = self.levels_at(t_s)
        data = message.image if isinstance(message, Frame) else message
        drawn = {}
        for kind, level in levels.items():
            drawn[kind] = self.draw(kind, level, message.sequence)
            data = module_of(self._sensor.type, kind).apply(drawn[kind], data)
        if getattr(drawn.get("interference"), "ghosts", 0):
            self._burst = drawn["interference"]
        if drawn and isinstance(message, Frame):
            return replace(message, image=data), drawn
        return data if drawn else message, drawn
