"""Receivers and latency of ``murk bench bus`` on real SocketCAN; points and goals are shown."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict

import pytest

from models.evaluate.report import Goal, Point
from tests.vm.marks import INSIDE, needs_machine

if INSIDE:
    from node.bench import bus, latency

pytestmark = needs_machine


def test_no_frame_of_a_real_bus_is_lost_by_either_receiver(
    capsys: pytest.CaptureFixture[str],
) -> None:
    results = list(bus.run(quick=True))
    with capsys.disabled():
        for result in results:
            sys.stdout.write(f"\n{json.dumps(asdict(result))}")
    points = [result for result in results if isinstance(result, Point)]
    (goal,) = [result for result in results if isinstance(result, Goal)]
    assert {point.unit for point in points} == {"frames lost (SocketCAN)"}
    assert {point.error for point in points} == {0}
    assert "SocketCAN" in goal.name
    assert goal.value > 1


def test_levels_reach_a_listener_on_a_real_bus(capsys: pytest.CaptureFixture[str]) -> None:
    points = list(latency.run(quick=True))
    with capsys.disabled():
        for point in points:
            sys.stdout.write(f"\n{json.dumps(asdict(point))}")
    over_can = [point for point in points if point.variant == "latency, CAN (vcan0)"]
    assert [point.knob for point in over_can] == ["p50", "p99"]
    assert all(0 < point.run_time_us < 5e6 for point in over_can)
