"""Asking a radar what it does, and telling it until it says that it does so."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dbc.errors import DeviceError, SceneError
from drivers.ars408_layout import ID_SHIFT
from drivers.can_bus import CanBus, open_bus
from drivers.can_frames import CanFrames
from drivers.radar_settings import (
    CONFIG_ID,
    FILTER_ID,
    FILTER_STATE_ID,
    SETTINGS,
    STATE_ID,
    VERSION_ID,
    RadarFilter,
    config_payload,
    decode_state,
    decode_version,
    differences,
)
from node.scene import Sensor

_READ_S = 0.1
_RESEND_S = 1.1
"""The sensor tells its state once a second."""
_LENGTHS = {STATE_ID: 8, FILTER_STATE_ID: 5, VERSION_ID: 4}


@dataclass(frozen=True, slots=True)
class RadarStatus:
    """What a radar says of itself: signals of 0x201 and 0x700; no version where none came."""

    state: dict[str, float]
    version: dict[str, float] | None


class RadarLink:
    """One radar on a bus. Also a context manager that closes the bus.

    Parameters
    ----------
    spec:
        The bus, as for ``open_bus``.
    sensor_id:
        SensorID 0–7.

    Raises
    ------
    DeviceError
        If the bus cannot be opened.
    """

    def __init__(self, spec: str, sensor_id: int = 0) -> None:
        self._name = f"radar {sensor_id} on {spec}"
        self._shift = ID_SHIFT * sensor_id
        self._bus: CanBus = open_bus(spec, ids=[can_id + self._shift for can_id in _LENGTHS])

    def __enter__(self) -> RadarLink:
        return self

    def __exit__(self, *_: object) -> None:
        self._bus.close()

    def status(self, timeout_s: float) -> RadarStatus:
        """Wait for the radar's state, and for its version if it sends one.

        Raises
        ------
        DeviceError
            If no state comes in time.
        """
        state = version = None
        for can_id, payload in self._heard(timeout_s):
            if can_id == STATE_ID:
                state = decode_state(payload)
            elif can_id == VERSION_ID:
                version = decode_version(payload)
            if state and version:
                break
        if state is None:
            raise self._silent(timeout_s)
        return RadarStatus(state, version)

    def configure(
        self,
        wanted: Mapping[str, float],
        filters: Sequence[RadarFilter] = (),
        *,
        store: bool = False,
        timeout_s: float = 5.0,
    ) -> None:
        """Send settings until the radar says that it has them all.

        Parameters
        ----------
        wanted:
            Physical value by flag, a key of ``drivers.radar_settings.SETTINGS``.
        filters:
            Filters to set.
        store:
            Once the radar has the settings, keep them in its non-volatile memory too. It wears out
            by that.
        timeout_s:
            How long to try, for setting and for storing each.

        Raises
        ------
        DeviceError
            If the radar does not answer, or keeps something else; it names what.
        InputError
            If a value is out of range.
        """
        orders = [(CONFIG_ID, config_payload(wanted))] if wanted else []
        orders += [(FILTER_ID, one.payload()) for one in filters]
        answers = _Answers(wanted, filters)
        give_up_s = time.monotonic() + timeout_s
        while answers.missing() and (left_s := give_up_s - time.monotonic()) > 0:
            self._send(orders)
            for can_id, payload in self._heard(min(left_s, _RESEND_S)):
                answers.hear(can_id, payload)
                if not answers.missing():
                    break
        if missing := answers.missing():
            if not answers.heard:
                raise self._silent(timeout_s)
            what = f"refused within {timeout_s:g} s: {', '.join(missing)}"
            raise DeviceError(self._name, what, "ask for what this radar can do")
        if store:
            self._store(wanted, timeout_s)

    def _store(self, wanted: Mapping[str, float], timeout_s: float) -> None:
        """Have the settings stored; asked for once, as every writing wears the memory."""
        self._send([(CONFIG_ID, config_payload(wanted, store=True))])
        for can_id, payload in self._heard(timeout_s):
            if can_id == STATE_ID and decode_state(payload)["NVMwriteStatus"]:
                return
        raise DeviceError(self._name, "did not store its settings", "they hold until it restarts")

    def _heard(self, duration_s: float) -> Iterator[tuple[int, bytes]]:
        """Yield identifier (without the radar's shift) and payload of the radar's answers."""
        give_up_s = time.monotonic() + duration_s
        while (left_s := give_up_s - time.monotonic()) > 0:
            frames = self._bus.read(min(left_s, _READ_S))
            rows = zip(frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True)
            for shifted_id, length, data in rows:
                can_id = shifted_id - self._shift
                if length >= _LENGTHS.get(can_id, 9):
                    yield can_id, data[:length].tobytes()

    def _send(self, orders: Sequence[tuple[int, bytes]]) -> None:
        for can_id, payload in orders:
            self._bus.send(_frame(can_id + self._shift, payload))

    def _silent(self, timeout_s: float) -> DeviceError:
        remedy = "is it powered, on this bus, at 500 kbit/s, with this SensorID?"
        return DeviceError(self._name, f"never answered within {timeout_s:g} s", remedy)


def apply_settings(sensor: Sensor, *, store: bool = False, timeout_s: float = 5.0) -> None:
    """Send the settings that a scene has for a radar until it confirms them.

    Raises
    ------
    DeviceError
        If the bus cannot be opened, or the radar does not answer or keeps something else.
    SceneError
        If the scene has no settings for it, or a value is impossible.
    """
    if sensor.settings is None:
        raise SceneError(sensor.name, "has no settings", "give [sensors.settings] in the scene")
    asked = sensor.settings.model_dump(exclude_none=True, exclude={"filters"})
    flags = {name.replace("_", "-"): value for name, value in asked.items()}
    wanted = {flag: SETTINGS[flag].value(value) for flag, value in flags.items()}
    filters = [RadarFilter.parse(text) for text in sensor.settings.filters]
    with RadarLink(sensor.source, sensor.sensor_id) as radar:
        radar.configure(wanted, filters, store=store, timeout_s=timeout_s)


class _Answers:
    """What of some wishes a radar has confirmed."""

    def __init__(self, wanted: Mapping[str, float], filters: Sequence[RadarFilter]) -> None:
        self._wanted = wanted
        self._filters = dict.fromkeys(filters, "is not confirmed")
        self._state: dict[str, float] | None = None
        self.heard = False

    def hear(self, can_id: int, payload: bytes) -> None:
        """Take in an answer."""
        self.heard = True
        if can_id == STATE_ID:
            self._state = decode_state(payload)
        elif can_id == FILTER_STATE_ID:
            for one in [one for one in self._filters if one.is_meant_by(payload)]:
                if one.is_said_by(payload):
                    del self._filters[one]
                else:
                    self._filters[one] = "has other values"

    def missing(self) -> list[str]:
        """Return in words what the radar has not confirmed."""
        missing = [f"filter {one.name} {why}" for one, why in self._filters.items()]
        if self._wanted and self._state is None:
            return ["it does not say its state", *missing]
        return differences(self._wanted, self._state or {}) + missing


def _frame(can_id: int, payload: bytes) -> CanFrames:
    return CanFrames(
        stamp_ns=np.zeros(1, np.int64),
        can_id=np.array([can_id], np.uint32),
        length=np.array([len(payload)], np.uint8),
        data=np.frombuffer(payload.ljust(8, b"\0"), np.uint8)[None],
        flags=np.zeros(1, np.uint8),
        channel=np.zeros(1, np.uint8),
    )
