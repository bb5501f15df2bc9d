"""Diagnostics: the severity follows the sensor, but does not flap."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.estimate.level import NoiseLevel
from node.bus.diagnostics import (
    DEBOUNCE_S,
    SensorDiagnosis,
    Severity,
    Status,
    diagnostic_array,
)
from node.bus.messages import deserialize, serialize, typestore
from node.health import SensorEvent, State

STEP_S = 0.05


def noise_level(level: float) -> NoiseLevel:
    return NoiseLevel(
        "front", 0, level, 3.0, np.full(11, 1 / 11), "blur", {"blur": 1.0}, level, None, 0, 4, 2
    )


class Sensor:
    """A diagnosis and a clock that goes on with every level, or with every silence."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.changes = 0
        self.diagnosis = SensorDiagnosis("murk_x: front", "can0", self.now_s)

    def gives(self, level: float, seconds: float) -> Severity:
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            self.diagnosis.on_level(noise_level(level), self.now_s)
            self.changes += self.diagnosis.update(self.now_s)
        return self.diagnosis.severity

    def is_silent(self, seconds: float) -> Severity:
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            self.changes += self.diagnosis.update(self.now_s)
        return self.diagnosis.severity

    def says(self, state: State) -> None:
        self.diagnosis.on_event(SensorEvent("front", 0, state, f"it is {state}"))


@pytest.mark.parametrize(
    ("level", "severity"),
    [(0, Severity.OK), (29, Severity.OK), (30, Severity.WARN), (70, Severity.ERROR)],
)
def test_severity_follows_the_level(level: float, severity: Severity) -> None:
    sensor = Sensor()
    assert sensor.diagnosis.severity == Severity.STALE
    assert sensor.gives(level, 1) == severity


def test_a_short_peak_changes_nothing_and_a_long_one_does() -> None:
    sensor = Sensor()
    sensor.gives(5, 1)
    assert sensor.gives(90, DEBOUNCE_S - 2 * STEP_S) == Severity.OK
    assert sensor.gives(5, 1) == Severity.OK
    assert sensor.gives(90, DEBOUNCE_S + 2 * STEP_S) == Severity.ERROR


@given(st.lists(st.floats(0, 100), min_size=1, max_size=80))
def test_severities_last_at_least_as_long_as_the_debounce(levels: list[float]) -> None:
    sensor = Sensor()
    for level in levels:
        sensor.gives(level, STEP_S)
    assert sensor.changes <= len(levels) * STEP_S / DEBOUNCE_S


def test_silence_is_stale_and_speech_ends_it() -> None:
    sensor = Sensor()
    sensor.gives(5, 1)
    assert sensor.is_silent(2) == Severity.STALE
    assert "no noise level for" in sensor.diagnosis.status(sensor.now_s).message
    assert sensor.gives(5, 1) == Severity.OK


def test_a_lost_sensor_is_an_error_and_a_silent_one_stale() -> None:
    sensor = Sensor()
    sensor.gives(5, 1)
    sensor.says("lost")
    assert sensor.is_silent(1) == Severity.ERROR
    assert sensor.diagnosis.status(sensor.now_s).message == "it is lost"
    sensor.says("stale")
    assert sensor.is_silent(1) == Severity.STALE
    sensor.says("ok")
    assert sensor.gives(80, 1) == Severity.ERROR


def test_the_array_has_a_status_a_sensor() -> None:
    sensor = Sensor()
    sensor.gives(45, 1)
    other = Status(Severity.OK, "murk_x: rear", "fine", "can1", {})
    store = typestore()
    array = diagnostic_array([sensor.diagnosis.status(sensor.now_s), other], 5_000_000_001, store)
    name, cdr = serialize(array, store)
    read = deserialize(name, cdr, store)
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (5, 1)
    assert [(one.level, one.name, one.hardware_id) for one in read.status] == [
        (1, "murk_x: front", "can0"),
        (0, "murk_x: rear", "can1"),
    ]
    assert read.status[0].message == "noise level 45 % ± 3 %, blur"
    assert {pair.key: pair.value for pair in read.status[0].values}["dropped"] == "2"
