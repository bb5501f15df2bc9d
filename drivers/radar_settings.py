"""What an ARS 408 can be told to do (0x200, 0x202), as payloads, and whether it says it does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any, cast

import cantools.database
import numpy as np
from cantools.database.can import Database as ParsedDatabase

from dbc.codec import ars408
from dbc.errors import SceneError

CONFIG_ID, STATE_ID, FILTER_ID, FILTER_STATE_ID, VERSION_ID = 0x200, 0x201, 0x202, 0x204, 0x700

_INPUT_BYTES = 8
"""Every input of the sensor has eight bytes; of 0x202 it uses five."""
_FILTER_BYTES = 5
_ACTIVE = 0b100
_SAID_OF_FILTER = bytes([0b11111101, 0xFF, 0xFF, 0xFF, 0xFF])
"""Mask: 0x204 is laid out as 0x202, and the Valid bit means nothing in it."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One setting of the sensor: its signals in 0x200 and 0x201, and the names of its values."""

    flag: str
    config: str
    state: str
    names: Mapping[str, int] = field(default_factory=dict)

    def value(self, asked: str | float) -> float:
        """Return the physical value of a name or number.

        Raises
        ------
        SceneError
            If there is no such name.
        """
        if not isinstance(asked, str):
            return float(asked)
        if asked not in self.names:
            raise SceneError(
                f"--{self.flag}", f"cannot be {asked!r}", f"give {', '.join(self.names)}"
            )
        return float(self.names[asked])

    def say(self, value: float) -> str:
        """Return a value in words."""
        return next((name for name, code in self.names.items() if code == value), f"{value:g}")


_SWITCH = {"off": 0, "on": 1}
SETTINGS = {
    setting.flag: setting
    for setting in (
        Setting("output", "OutputType", "OutputTypeCfg", {"none": 0, "objects": 1, "clusters": 2}),
        Setting("quality", "SendQuality", "SendQualityCfg", _SWITCH),
        Setting("extended", "SendExtInfo", "SendExtInfoCfg", _SWITCH),
        Setting("max-distance", "MaxDistance", "MaxDistanceCfg"),
        Setting(
            "power", "RadarPower", "RadarPowerCfg", {"standard": 0, "-3dB": 1, "-6dB": 2, "-9dB": 3}
        ),
        Setting("sort-index", "SortIndex", "SortIndex"),
        Setting("rcs-threshold", "RCS_Threshold", "RCS_Threshold", {"standard": 0, "high": 1}),
    )
}
"""By flag."""


@dataclass(frozen=True, slots=True)
class RadarFilter:
    """Let through only clusters or objects with a property between two values.

    Attributes
    ----------
    type:
        ``"cluster"`` or ``"object"``.
    name:
        Name of the filter in the DBC, such as ``Distance``.
    low, high:
        In the unit of the DBC; the sensor's grid rounds them.
    """

    type: str
    name: str
    low: float
    high: float

    @classmethod
    def parse(cls, text: str) -> RadarFilter:
        """Read ``NAME:MIN:MAX``, or ``object:NAME:MIN:MAX`` for objects.

        Raises
        ------
        SceneError
            If it is not of that form, or no filter has the name or the values.
        """
        kind, _, rest = text.partition(":") if text.count(":") == 3 else ("cluster", "", text)
        try:
            name, low, high = rest.split(":")
            wanted = cls(kind, name, float(low), float(high))
        except ValueError:
            raise SceneError("--filter", f"{text!r} is no filter", "give NAME:MIN:MAX") from None
        wanted.payload()
        return wanted

    def payload(self) -> bytes:
        """Return the filter as 0x202.

        Raises
        ------
        SceneError
            If there is no such filter, or it cannot have these values.
        """
        message = _parsed().get_message_by_name("FilterCfg")
        indices = {str(name): index for index, name in _choices("FilterCfg_Index").items()}
        types = {str(name): code for code, name in _choices("FilterCfg_Type").items()}
        if self.name not in indices or self.type not in types:
            known = ", ".join(indices)
            raise SceneError("--filter", f"there is no {self.type} filter {self.name}", known)
        values: dict[str, Any] = {
            "FilterCfg_Type": types[self.type],
            "FilterCfg_Index": indices[self.name],
            "FilterCfg_Active": 1,
            "FilterCfg_Valid": 1,
            f"FilterCfg_Min_{self.name}": self.low,
            f"FilterCfg_Max_{self.name}": self.high,
        }
        if not self.low <= self.high:
            raise SceneError("--filter", f"{self.name} from {self.low:g} to {self.high:g}", "swap")
        try:
            return bytes(message.encode(values)).ljust(_INPUT_BYTES, b"\0")
        except cantools.database.EncodeError as error:
            raise SceneError("--filter", str(error), "give values in range") from error

    def is_said_by(self, state: bytes) -> bool:
        """Tell whether a 0x204 says that this filter is active with these values."""
        return _masked(state) == _masked(self.payload())

    def is_meant_by(self, state: bytes) -> bool:
        """Tell whether a 0x204 speaks of this filter, whatever its values."""
        own = self.payload()
        type_and_index = 0b11111000
        return len(state) >= _FILTER_BYTES and (state[0] ^ own[0]) & type_and_index == 0


def config_payload(wanted: Mapping[str, float], *, store: bool = False) -> bytes:
    """Return settings as 0x200; what is not wanted stays as it is.

    Parameters
    ----------
    wanted:
        Physical value by flag, a key of ``SETTINGS``.
    store:
        Keep the sensor's settings in its non-volatile memory, which wears out by that.

    Raises
    ------
    InputError
        If a value is out of range.
    """
    codec = ars408().message("RadarConfig")
    values: dict[str, float] = dict.fromkeys(codec.signals, 0.0)
    for flag, value in wanted.items():
        values[f"RadarCfg_{SETTINGS[flag].config}"] = value
        values[f"RadarCfg_{SETTINGS[flag].config}_valid"] = 1.0
    if store:
        values["RadarCfg_StoreInNVM"] = values["RadarCfg_StoreInNVM_valid"] = 1.0
    return codec.encode({name: [value] for name, value in values.items()}).tobytes()


def decode_state(payload: bytes) -> dict[str, float]:
    """Return the physical values of a 0x201 by signal, without the prefix of its message."""
    return _decode("RadarState", payload)


def say_state(state: Mapping[str, float]) -> dict[str, str]:
    """Return the values of a state (``decode_state``) in the words and units of the DBC."""
    signals = _parsed().get_message_by_name("RadarState").signals
    said: dict[str, str] = {}
    for signal in signals:
        name = signal.name.partition("_")[2]
        choices: Mapping[int, Any] = signal.choices or {}
        words = choices.get(int(state[name]), f"{state[name]:g}")
        said[name] = f"{words} {signal.unit or ''}".strip()
    return said


def decode_version(payload: bytes) -> dict[str, float]:
    """Return the values of a 0x700 by signal, without the prefix of its message."""
    return _decode("VersionID", payload)


def differences(wanted: Mapping[str, float], state: Mapping[str, float]) -> list[str]:
    """Return in words which settings a state (``decode_state``) has otherwise than wanted."""
    asked = ars408().message("RadarConfig").decode(_row(config_payload(wanted)))
    different: list[str] = []
    for flag in wanted:
        setting = SETTINGS[flag]
        value = float(asked[f"RadarCfg_{setting.config}"][0])
        if state[setting.state] != value:
            said = setting.say(state[setting.state])
            different.append(f"{flag} is {said}, not {setting.say(value)}")
    return different


def _decode(message: str, payload: bytes) -> dict[str, float]:
    columns = ars408().message(message).decode(_row(payload))
    return {name.partition("_")[2]: column[0].item() for name, column in columns.items()}


def _row(payload: bytes) -> np.ndarray[Any, np.dtype[np.uint8]]:
    return np.frombuffer(payload, np.uint8)[None]


def _masked(payload: bytes) -> bytes:
    return bytes(a & b for a, b in zip(payload, _SAID_OF_FILTER, strict=False))


def _choices(signal: str) -> Mapping[int, Any]:
    return _parsed().get_message_by_name("FilterCfg").get_signal_by_name(signal).choices or {}


@cache
def _parsed() -> ParsedDatabase:
    """Return the DBC as cantools reads it: 0x202 is multiplexed, which the codec leaves to it."""
    text = files("dbc").joinpath("ars408.dbc").read_text(encoding="utf-8")
    parsed = cantools.database.load_string(text, database_format="dbc")
    return cast(ParsedDatabase, parsed)
