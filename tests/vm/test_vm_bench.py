"""The receivers of ``murk bench bus`` on real SocketCAN; their points and goals are shown."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict

import pytest

from models.evaluate.report import Goal, Point
from tests.vm.marks import INSIDE, needs_machine

if INSIDE:
    from node.bench import bus

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
