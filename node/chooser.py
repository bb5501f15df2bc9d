"""Which model the noise levels ask for: the rules of a switch, applied over time."""

from __future__ import annotations

from time import time_ns

from models.estimate.level import NoiseLevel
from node.events import ModelChoice
from node.switch_rules import Rule, Switch


class Chooser:
    """Applies the rules of a switch to levels as they come; it reads no clock that decides.

    The first rule that holds decides. Changes are at least ``dwell_s`` apart, but a rule of
    staleness acts at once: a sensor that is gone is not waited for. While a sensor is stale its
    last level says nothing any more. A level that is not between 0 and 100 % is not heard.

    Attributes
    ----------
    rules:
        What it applies.
    model:
        The model that it chose; the default until the first update.
    choices:
        How often it chose, the first time counted in.
    """

    def __init__(self, rules: Switch) -> None:
        self.rules = rules
        self.model = rules.default
        self.choices = 0
        self._now_ns: int | None = None
        self._changed_ns: int | None = None
        self._heard_ns: dict[str, int] = {}
        self._levels: dict[str, NoiseLevel] = {}
        self._newest: NoiseLevel | None = None
        self._newest_ns = 0
        self._held: set[Rule] = set()

    def update(self, level: NoiseLevel | None, now_ns: int) -> ModelChoice | None:
        """Take in a level, or that none came; return the choice where it is a new one.

        Parameters
        ----------
        level:
            Of any sensor; None where only time passed.
        now_ns:
            The time now by any clock that runs on, nanoseconds; the same clock at every call.
        """
        now_ns = self._now_ns = now_ns if self._now_ns is None else max(now_ns, self._now_ns)
        for sensor in self.rules.sensors:
            self._heard_ns.setdefault(sensor, now_ns)
        if level is not None and level.sensor in self._heard_ns and 0 <= level.level <= 100:
            self._heard_ns[level.sensor] = now_ns
            self._levels[level.sensor] = self._newest = level
            self._newest_ns = now_ns
        self._forget_stale_levels(now_ns)
        self._held = {rule for rule in self.rules.rules if self._holds(rule, now_ns)}
        rule = next((rule for rule in self.rules.rules if rule in self._held), None)
        model = self.rules.default if rule is None else rule.model
        if self.choices and (model == self.model or self._must_stay(rule, now_ns)):
            return None
        previous, self.model = self.model if self.choices else "", model
        if self.choices:
            self._changed_ns = now_ns
        self.choices += 1
        reason = self._reason(rule, now_ns)
        return ModelChoice(self.rules.name, self._stamp_ns(now_ns), model, previous, reason)

    def _forget_stale_levels(self, now_ns: int) -> None:
        for rule in self.rules.rules:
            if rule.stale_s is not None and self._silence_s(rule.sensor, now_ns) > rule.stale_s:
                self._levels.pop(rule.sensor, None)

    def _holds(self, rule: Rule, now_ns: int) -> bool:
        if rule.stale_s is not None:
            return self._silence_s(rule.sensor, now_ns) > rule.stale_s
        level = self._levels.get(rule.sensor)
        return level is not None and rule.holds(level, rule in self._held)

    def _must_stay(self, rule: Rule | None, now_ns: int) -> bool:
        if self._changed_ns is None or (rule is not None and rule.stale_s is not None):
            return False
        return now_ns - self._changed_ns < self.rules.dwell_s * 1e9

    def _silence_s(self, sensor: str, now_ns: int) -> float:
        return (now_ns - self._heard_ns[sensor]) * 1e-9

    def _stamp_ns(self, now_ns: int) -> int:
        """Return the time of a choice by the clock that the levels are stamped with."""
        if self._newest is None:
            return time_ns()
        return self._newest.stamp_ns + now_ns - self._newest_ns

    def _reason(self, rule: Rule | None, now_ns: int) -> str:
        if rule is None:
            said = [_said(level) for level in self._levels.values()]
            return f"no rule holds: {', '.join(said) or 'no level yet'}"
        if rule.stale_s is not None:
            silence = f"{self._silence_s(rule.sensor, now_ns):.2f} s without a level"
            return f"{rule.sensor} is stale: {silence}, {rule.stale_s:g} s allowed"
        bound = f"at least {rule.above:g}" if rule.above is not None else f"at most {rule.below:g}"
        return f"{_said(self._levels[rule.sensor])}: rule {bound} %, hysteresis {rule.hysteresis:g}"


def _said(level: NoiseLevel) -> str:
    return f"{level.sensor} at {level.level:.0f} % ({level.kind})"
