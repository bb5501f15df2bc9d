"""The rules of a switch, as a scene says them: which model when."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from models.estimate.level import CAMERA_KINDS, RADAR_KINDS, NoiseLevel

Name = Annotated[str, Field(pattern=r"^[a-zA-Z][a-zA-Z0-9_]*$")]
Percent = Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)]
PositiveSeconds = Annotated[float, Field(gt=0, le=3600, allow_inf_nan=False)]

_ESTIMATED = {"camera": CAMERA_KINDS, "radar": RADAR_KINDS}


class Rule(BaseModel):
    """One sensor's condition, and the model that it asks for while it holds.

    Exactly one condition: ``above`` holds from that level (%) up, until the level is below it by
    more than ``hysteresis``; ``below`` the other way round; ``stale_s`` holds while the sensor has
    sent no level for longer than so many seconds, or never. A condition on the level may be for
    some ``kinds`` of noise only: what blinds one model another may hardly notice.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    sensor: str
    model: Name
    above: Percent | None = None
    below: Percent | None = None
    hysteresis: Percent | None = None
    kinds: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    stale_s: PositiveSeconds | None = None

    @model_validator(mode="after")
    def _one_condition_that_can_begin_and_end(self) -> Self:
        conditions = (self.above, self.below, self.stale_s)
        if sum(condition is not None for condition in conditions) != 1:
            raise ValueError("give one of 'above', 'below' and 'stale_s'")
        if self.stale_s is not None:
            for name in ("hysteresis", "kinds"):
                if getattr(self, name) is not None:
                    raise ValueError(f"'{name}' is of a level, not of 'stale_s'")
        elif self.hysteresis is None:
            raise ValueError("give 'hysteresis', the points of level by which the rule holds on")
        elif self.above is not None and self.above - self.hysteresis <= 0:
            raise ValueError("'above' less 'hysteresis' must be more than 0: it would never end")
        elif self.below is not None and self.below + self.hysteresis >= 100:
            raise ValueError("'below' plus 'hysteresis' must be less than 100: it would never end")
        return self

    def holds(self, level: NoiseLevel, before: bool) -> bool:
        """Return whether a rule on the level holds at this one, having held before or not."""
        if self.kinds is not None and level.kind not in self.kinds:
            return False
        kept = self.hysteresis if before and self.hysteresis is not None else 0.0
        if self.above is not None:
            return level.level >= self.above - kept
        return self.below is not None and level.level <= self.below + kept


class Switch(BaseModel):
    """A switch between models by the noise levels.

    The first rule that holds decides; ``default`` is the model while none does. A model stays for
    at least ``dwell_s`` seconds; only silence does not wait. Every sensor that a rule names needs a
    rule with ``stale_s`` too: what to do without it is part of the switch.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Name
    default: Name
    dwell_s: Annotated[float, Field(ge=0, le=3600, allow_inf_nan=False)] = 1.0
    rules: Annotated[tuple[Rule, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _silence_is_provided_for(self) -> Self:
        provided = [rule.sensor for rule in self.rules if rule.stale_s is not None]
        for sensor in self.sensors:
            if provided.count(sensor) != 1:
                how_many = "no rule says" if sensor not in provided else "two rules say"
                raise ValueError(
                    f"{how_many} which model when '{sensor}' is silent: give one with 'stale_s'"
                )
        return self

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors that the rules name, in order."""
        return tuple(dict.fromkeys(rule.sensor for rule in self.rules))

    @property
    def models(self) -> tuple[str, ...]:
        """The models that it chooses between, the default first."""
        return tuple(dict.fromkeys((self.default, *(rule.model for rule in self.rules))))


def check_switches(switches: tuple[Switch, ...], sensors: Mapping[str, str]) -> None:
    """Raise ValueError where two switches share a name, or a rule names what there is not.

    Parameters
    ----------
    sensors:
        Type of each sensor of the scene, by name.
    """
    names = [switch.name for switch in switches]
    for number, switch in enumerate(switches):
        if names.index(switch.name) < number:
            raise ValueError(f"switches.{number}: '{switch.name}' is given twice")
        for place, rule in enumerate(switch.rules):
            where = f"switches.{number}.rules.{place}: "
            if rule.sensor not in sensors:
                known = _list(sensors)
                raise ValueError(f"{where}of '{rule.sensor}', but the sensors are {known}")
            estimated = _ESTIMATED[sensors[rule.sensor]]
            for kind in rule.kinds or ():
                if kind not in estimated:
                    what = f"no level of a {sensors[rule.sensor]} is of kind '{kind}', but of "
                    raise ValueError(where + what + _list(estimated))


def _list(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
