"""The scene: which sensors there are, what is injected into them, and what comes out.

A scene is a TOML file or built from flags; either way it is checked here, and an error names the
field that is wrong.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PositiveInt,
    ValidationError,
    model_validator,
)

from dbc.errors import SceneError
from models.degrade.draw import DrawKey
from models.degrade.kinds import KINDS, OPTIONS
from models.degrade.sequence import Burst, Constant, Ramp, RandomWalk, Schedule, Step
from node.camera_faults import CAMERA_FAULTS
from node.link_faults import LINK_FAULTS
from node.recording import is_recording, split_source
from node.switch_rules import Switch, check_switches

SensorType = Literal["radar", "camera"]
WORLD = "world"
"""The source that is the simulated world."""

FAULTS: dict[str, tuple[str, ...]] = {"camera": CAMERA_FAULTS, "radar": LINK_FAULTS}
"""Faults that a gateway can make, by sensor type."""

Level = Annotated[float, Field(ge=0, le=100, allow_inf_nan=False, strict=True)]
Seconds = Annotated[float, Field(ge=0, le=1e12, allow_inf_nan=False, strict=True)]
_ANY_LEVEL = (0.0, 100.0)


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class RadarSettings(_Strict):
    """What a radar is told to do; see ``murk radar configure --help`` for names and units."""

    output: Literal["none", "objects", "clusters"] | None = None
    quality: bool | None = None
    extended: bool | None = None
    max_distance: Annotated[float, Field(gt=0)] | None = None
    power: Literal["standard", "-3dB", "-6dB", "-9dB"] | None = None
    sort_index: Annotated[int, Field(ge=0, le=7)] | None = None
    rcs_threshold: Literal["standard", "high"] | None = None
    filters: tuple[str, ...] = ()


class Sensor(_Strict):
    """One sensor and where its data comes from.

    ``source`` is a file (a CAN log, a video, a folder of images, an MCAP recording with or without
    ``:/topic`` behind it), a device (``/dev/video0``), a CAN bus (``socketcan:can0``) or ``world``,
    the simulated one. ``sensor_id`` is the radar's
    SensorID, which shifts its CAN IDs by 0x10 each. ``motion`` is a CAN log or bus whose speed and
    yaw rate (0x300, 0x301) are sent to a radar on a bus, 20 times a second. ``size`` (width,
    height), ``rate_hz`` and ``pixel_format`` are asked of a live camera; by default it is taken as
    it is. ``settings`` are sent to a radar on a bus until it confirms them. ``calibration`` is a
    file of ``murk calibrate`` that corrects this sensor's estimates. ``adaptive`` lets the
    estimator leave frames or scans out, or only glance at a frame, while the level is certain and
    steady.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    type: SensorType
    source: Annotated[str, Field(min_length=1)]
    sensor_id: Annotated[int, Field(ge=0, le=7)] = 0
    motion: str | None = None
    settings: RadarSettings | None = None
    size: tuple[PositiveInt, PositiveInt] | None = None
    rate_hz: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    pixel_format: Literal["MJPG", "YUYV"] | None = None
    calibration: Path | None = None
    adaptive: bool = False


_SCHEDULES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "step": ((), ("level", "points")),
    "ramp": ((), ("level", "points")),
    "walk": (("level", "spread"), ("bounds",)),
    "burst": (("level", "duration_s", "period_s"), ("rest",)),
}
"""Fields of a schedule by shape: those that it needs, and those that it may have."""


class Injection(_Strict):
    """A degradation of one sensor over time, counted from the sensor's first message.

    Either ``level`` (%, constant) or ``points``, pairs of seconds and level (%): before the first
    point the level is 0; between points it holds (``shape = "step"``) or goes straight from one
    to the next (``"ramp"``); after the last it stays. A ``"walk"`` starts at ``level`` and walks
    at random between ``bounds``, by ``spread`` (%, standard deviation) in a second. A ``"burst"``
    is ``level`` for ``duration_s`` at the start of every ``period_s``, else ``rest``.

    ``horizon`` is the share of the image above it, for weather; ``ghost_life`` the number of scans
    in which the same ghosts appear; ``snr_drop_db`` the loss at 100 %, dB, and ``quality`` whether
    the radar's own quality fields follow it; ``std_max`` the noise at 100 %, counts; ``method``
    which variant of blur, exposure or noise it is.
    """

    sensor: str
    kind: str
    level: Level | None = None
    points: Annotated[tuple[tuple[Seconds, Level], ...], Field(min_length=1)] | None = None
    shape: Literal["step", "ramp", "walk", "burst"] = "step"
    spread: Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)] | None = None
    bounds: tuple[Level, Level] | None = None
    duration_s: Annotated[float, Field(ge=1e-9, le=1e12, allow_inf_nan=False)] | None = None
    period_s: Annotated[float, Field(ge=1e-9, le=1e12, allow_inf_nan=False)] | None = None
    rest: Level | None = None
    horizon: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] | None = None
    ghost_life: PositiveInt | None = None
    snr_drop_db: Annotated[float, Field(ge=0, le=300, allow_inf_nan=False)] | None = None
    quality: Literal["frozen", "consistent"] | None = None
    std_max: Annotated[float, Field(ge=0, le=255, allow_inf_nan=False)] | None = None
    method: Literal["fast", "exact", "published"] | None = None

    @model_validator(mode="after")
    def _one_schedule(self) -> Self:
        needed, allowed = _SCHEDULES[self.shape]
        if not needed and (self.level is None) == (self.points is None):
            raise ValueError("give either 'level' or 'points'")
        for name in needed:
            if getattr(self, name) is None:
                raise ValueError(f"shape '{self.shape}' needs '{name}'")
        every = ("level", "points", "spread", "bounds", "duration_s", "period_s", "rest")
        for name in every:
            if getattr(self, name) is not None and name not in needed + allowed:
                raise ValueError(f"'{name}' is not of shape '{self.shape}'")
        return self

    @model_validator(mode="after")
    def _possible(self) -> Self:
        times = [t for t, _ in self.points or ()]
        if times != sorted(times):
            raise ValueError("the times of 'points' must not decrease")
        if self.shape == "walk":
            low, high = self.bounds or _ANY_LEVEL
            if low >= high:
                raise ValueError("the first of 'bounds' must be below the second")
            if not low <= (self.level or 0.0) <= high:
                raise ValueError("'level' must lie within 'bounds'")
        if (self.duration_s or 0.0) > (self.period_s or math.inf):
            raise ValueError("'duration_s' must not be longer than 'period_s'")
        for name in self.options:
            if self.kind not in OPTIONS[name]:
                raise ValueError(f"'{name}' is not of kind '{self.kind}'")
        if self.method == "published" and self.kind in ("over", "under"):
            raise ValueError(f"'{self.kind}' has no published method")
        return self

    @property
    def options(self) -> dict[str, Any]:
        """What else the kind's ``draw`` is given."""
        every = {name: getattr(self, name) for name in OPTIONS}
        return {name: value for name, value in every.items() if value is not None}

    def schedule(self, seed: int) -> Schedule:
        """Return the level over time; a walk depends on the run's seed, the sensor and the kind."""
        level = self.level or 0.0
        if self.shape == "walk":
            generator = DrawKey(seed, self.sensor, 0).generator(f"walk of {self.kind}")
            own_seed = int(generator.bit_generator.random_raw())
            return RandomWalk(own_seed, level, self.spread or 0.0, *(self.bounds or _ANY_LEVEL))
        if self.shape == "burst":
            return Burst(level, self.duration_s or 0.0, self.period_s or 0.0, self.rest or 0.0)
        if self.points is None:
            return Constant(level)
        return (Ramp if self.shape == "ramp" else Step)(self.points)


class Clock(_Strict):
    """How recordings and the simulated world are paced; live sensors pace themselves.

    ``speed`` multiplies real time; ``fast`` means as fast as possible, with nothing dropped;
    ``loop`` starts recordings again at their end.
    """

    speed: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)] = 1.0
    fast: bool = False
    loop: bool = False


class Ros2Settings(_Strict):
    """ROS 2 over DDS.

    ``domain`` is by default that of ``ROS_DOMAIN_ID``, else 0; ``namespace`` goes before every
    topic's name but that of ``/diagnostics``; only this computer hears it unless ``network`` is
    true. ``scans`` and ``images`` are sent on too where they are true.
    """

    domain: Annotated[int, Field(ge=0, le=232)] | None = None
    namespace: Annotated[str, Field(pattern=r"^(/?[a-zA-Z_][a-zA-Z0-9_]*)*$")] = ""
    network: bool = False
    scans: bool = False
    images: bool = False


class CanSettings(_Strict):
    """Levels on a CAN bus by ``dbc/noise_level.dbc``; the first sensor has ``first_id``."""

    bus: Annotated[str, Field(min_length=1)]
    first_id: Annotated[int, Field(ge=0, le=0x7FF)] = 0x6F0


class RecordSettings(_Strict):
    """MCAP recording; a new file begins after ``split_s`` seconds or ``split_mb`` megabytes."""

    path: Path
    scans: bool = True
    images: bool = False
    split_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    split_mb: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None


class ViewSettings(_Strict):
    """The page; a ``host`` that other computers reach needs a ``token``."""

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8408
    token: Annotated[str, Field(min_length=8)] | None = None

    @model_validator(mode="after")
    def _others_need_a_token(self) -> Self:
        if self.token is None and self.host not in ("127.0.0.1", "::1", "localhost"):
            raise ValueError(f"other computers reach {self.host}: give a token (--token)")
        return self


class Outputs(_Strict):
    """Where the levels go beside the bus in process; each is left out where it is not given.

    ``picture`` is a PNG file that gets injected and estimated levels over time.
    """

    picture: Path | None = None
    ros2: Ros2Settings | None = None
    can: CanSettings | None = None
    record: RecordSettings | None = None
    view: ViewSettings | None = None


class Scene(_Strict):
    """Everything a run needs to know; ``faults``, with rates for levels, only a gateway makes."""

    name: str = "scene"
    seed: Annotated[int, Field(ge=0)] = 0
    duration_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    clock: Clock = Clock()
    sensors: Annotated[tuple[Sensor, ...], Field(min_length=1)]
    injections: tuple[Injection, ...] = ()
    faults: tuple[Injection, ...] = ()
    switches: tuple[Switch, ...] = ()
    outputs: Outputs = Outputs()

    @model_validator(mode="after")
    def _names_and_kinds_exist(self) -> Self:
        types = {sensor.name: sensor.type for sensor in self.sensors}
        if len(types) < len(self.sensors):
            raise ValueError("two sensors have the same name")
        _check_kinds("injections", self.injections, types, KINDS)
        _check_kinds("faults", self.faults, types, FAULTS)
        check_switches(self.switches, types)
        return self


def _check_kinds(
    table: Literal["injections", "faults"],
    entries: tuple[Injection, ...],
    types: dict[str, SensorType],
    known: Mapping[str, tuple[str, ...]],
) -> None:
    word = "kind" if table == "injections" else "fault"
    seen: set[tuple[str, str]] = set()
    for number, entry in enumerate(entries):
        place = f"{table}.{number}: "
        if entry.sensor not in types:
            what = f"{word} of '{entry.sensor}', but the sensors are {_list(types)}"
            raise ValueError(place + what)
        sensor_type = types[entry.sensor]
        if entry.kind not in known[sensor_type]:
            what = f"a {sensor_type} has no {word} '{entry.kind}'; it has "
            raise ValueError(place + what + _list(known[sensor_type]))
        if (entry.sensor, entry.kind) in seen:
            raise ValueError(f"{place}{entry.kind} is given twice")
        seen.add((entry.sensor, entry.kind))


def _list(names: Sequence[str] | Mapping[str, Any]) -> str:
    return ", ".join(f"'{name}'" for name in names)


def check_scene(content: dict[str, Any], where: object) -> Scene:
    """Build a scene from the content of a TOML file or from flags.

    Raises
    ------
    SceneError
        Naming ``where`` and the field, if a key is unknown or a value impossible.
    """
    try:
        return Scene.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        what = first["msg"].removeprefix("Value error, ")
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        if first["type"] == "extra_forbidden":
            what = "is not a key that murk knows"
        place = f"{where}: {field}" if field else where
        raise SceneError(place, what + more, "see docs/scene.md") from None


def read_scene_file(path: Path) -> dict[str, Any]:
    """Return the content of a scene file, relative paths in it resolved against its folder.

    Raises
    ------
    SceneError
        If the file cannot be read or is not TOML (with the line).
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SceneError(path, error.strerror or "cannot be read", "give a TOML file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SceneError(path, f"is not TOML: {error}", "see docs/scene.md") from None
    sensors = content.get("sensors")
    for sensor in sensors if isinstance(sensors, list) else []:
        for key in ("source", "motion", "calibration") if isinstance(sensor, dict) else ():
            if key in sensor:
                sensor[key] = _beside(path.parent, str(sensor[key]))
    return content


def _beside(folder: Path, source: str) -> str:
    """Return the source in the scene's folder where there is such a file."""
    file = split_source(source)[0] if is_recording(source) else Path(source)
    return str(folder / source) if (folder / file).exists() else source


def parse_injection(flag: str) -> dict[str, Any]:
    """Turn ``SENSOR:KIND:LEVEL`` into the content of an injection.

    Raises
    ------
    SceneError
        If the flag does not have three parts, or its level is not a number.
    """
    parts = flag.split(":")
    try:
        sensor, kind, level = parts
        return {"sensor": sensor, "kind": kind, "level": float(level)}
    except ValueError:
        expected = "expected SENSOR:KIND:LEVEL, for example camera:noise:60"
        raise SceneError(f"--inject {flag}", "is not an injection", expected) from None
