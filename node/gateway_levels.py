"""What a gateway injects into its sensor and when: by schedule, or by a call while it runs."""

from __future__ import annotations

from collections.abc import Iterable
from threading import Lock

from dbc.errors import SceneError
from models.degrade.kinds import KINDS
from node.injector import Injector
from node.scene import FAULTS, Injection, Sensor


class GatewayLevels:
    """The levels of one sensor's injections and the rates of its faults, all in %.

    Parameters
    ----------
    sensor:
        The gateway's sensor.
    injections, faults:
        Schedules; a fault's level is its rate.
    seed:
        The run's seed.

    Attributes
    ----------
    injector:
        Degrades the sensor's messages.
    """

    def __init__(
        self,
        sensor: Sensor,
        injections: Iterable[Injection],
        faults: Iterable[Injection],
        seed: int,
    ) -> None:
        self.injector = Injector(sensor, injections, seed)
        self._sensor = sensor
        self._schedule = {fault.kind: fault.schedule(seed) for fault in faults}
        self._set: dict[str, float] = {}
        self._lock = Lock()

    def set_level(self, kind: str, level: float) -> None:
        """Set the level of an injection or the rate of a fault (%) from now on.

        Raises
        ------
        SceneError
            If the sensor has no such kind, or the level is outside 0–100 %.
        """
        faults = FAULTS[self._sensor.type]
        kinds = (*KINDS[self._sensor.type], *faults)
        if kind not in kinds:
            expected = f"a {self._sensor.type} has {', '.join(kinds)}"
            raise SceneError(self._sensor.name, f"has no kind '{kind}'", expected)
        if kind not in faults:
            self.injector.set_level(kind, level)
            return
        if not 0 <= level <= 100:
            raise SceneError(f"{self._sensor.name}:{kind}", f"rate {level}", "expected 0 to 100")
        with self._lock:
            self._set[kind] = level

    def rates_at(self, t_s: float) -> dict[str, float]:
        """Return the faults' rates (%) above 0 in force ``t_s`` seconds after the first message."""
        rates = {kind: fault.level_at(t_s) for kind, fault in self._schedule.items()}
        with self._lock:
            rates |= self._set
        return {kind: rate for kind, rate in rates.items() if rate > 0}

    def any_at(self, t_s: float) -> bool:
        """Tell whether anything is in force ``t_s`` seconds after the first message."""
        return bool(self.injector.levels_at(t_s) or self.rates_at(t_s))
