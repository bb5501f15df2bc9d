from __future__ import annotations

from dataclasses import replace

import pytest

from models.degrade.camera import apply, draw
from models.degrade.draw import DrawKey
from models.estimate.level import NoiseLevel
from models.evaluate.radar import degraded, simulated_drive
from models.world.camera import WorldCamera
from models.world.road import World
from node.estimator import Estimator
from node.plan import plan
from node.scene import check_scene

CAMERA = {"name": "camera", "type": "camera", "source": "world"}
RADAR = {"name": "front", "type": "radar", "source": "world"}


def follow(estimator: Estimator, level: float) -> list[NoiseLevel]:
    """Return the levels of a second of a clean drive, then a second of it with noise."""
    camera = WorldCamera(World(5, 2.0), width=640, height=360, rate_hz=20.0)
    levels = []
    for frame in camera.frames():
        noise = draw("noise", level if frame.sequence >= 20 else 0.0, DrawKey(0, "c", 0))
        degraded = replace(frame, image=apply(noise, frame.image))
        levels.append(estimator.estimate(degraded, arrival_ns=0, injected=None, dropped=0))
    return levels


def test_adaptive_effort_says_what_it_took_and_sees_a_step_nearly_as_soon() -> None:
    whole = follow(Estimator("camera"), 60.0)
    adaptive = follow(Estimator("camera", adaptive=True), 60.0)
    assert {level.effort for level in whole} == {1.0}
    efforts = [level.effort for level in adaptive]
    assert efforts[0] == 1.0
    assert 0.0 in efforts[:20]
    assert sum(efforts[:20]) < 10
    assert [level.stamp_ns for level in adaptive] == [level.stamp_ns for level in whole]
    assert adaptive[19].level == pytest.approx(whole[19].level, abs=3)
    assert adaptive[25].level == pytest.approx(60, abs=8)
    assert adaptive[25].kind == "noise"


def test_adaptive_radar_leaves_scans_out_carries_the_level_on_and_sees_a_step() -> None:
    scans = simulated_drive(2**31 + 4000, 40, 70).scans
    whole, adaptive = Estimator("radar"), Estimator("radar", adaptive=True)
    pairs = []
    for number, scan in enumerate(scans):
        noisy = degraded(scan, "snr", 70.0 if number >= 40 else 0.0, seed=1)
        pairs.append(
            [
                each.estimate(noisy, arrival_ns=0, injected=None, dropped=0)
                for each in (whole, adaptive)
            ]
        )
    efforts = [level.effort for _, level in pairs]
    assert {level.effort for level, _ in pairs} == {1.0}
    assert set(efforts) == {0.0, 1.0}
    assert sum(efforts[:40]) < 30
    assert efforts[:2] == [1.0, 1.0]
    before, after = pairs[39], pairs[55]
    assert before[1].level == pytest.approx(before[0].level, abs=5)
    assert after[1].level == pytest.approx(70, abs=12)


@pytest.mark.parametrize("sensor", [CAMERA, RADAR], ids=["camera", "radar"])
def test_the_plan_says_so(sensor: dict[str, str]) -> None:
    for adaptive in (False, True):
        stages = plan(check_scene({"sensors": [sensor | {"adaptive": adaptive}]}, "mine")).stages
        reason = next(stage.reason for stage in stages if stage.name == "estimate")
        assert ("while certain" in reason) is adaptive
