from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dbc.errors import SceneError
from drivers.frame import Frame
from models.degrade import camera
from models.degrade.draw import DrawKey
from models.degrade.kinds import KINDS
from models.world.radar import WorldRadar
from models.world.road import World
from node.injector import Injector
from node.scene import Injection, Sensor

CAMERA = Sensor(name="camera", type="camera", source="world")
RADAR = Sensor(name="front", type="radar", source="world")


def frame(sequence: int = 0) -> Frame:
    image = np.random.default_rng(sequence).integers(0, 255, (40, 60, 3), np.uint8)
    return Frame(image, "camera", sequence, sequence * 40_000_000, "simulated")


def noise_from(t_s: float, level: float) -> Injection:
    return Injection(sensor="camera", kind="noise", points=((t_s, level),))


def test_nothing_is_touched_before_the_schedule_begins() -> None:
    injector = Injector(CAMERA, [noise_from(2, 50)], seed=1)
    message, injected = injector.inject(frame(), 1.9)
    assert not injected
    np.testing.assert_array_equal(message.image, frame().image)


def test_the_same_seed_degrades_the_same_message_alike_whatever_came_before() -> None:
    first, second = (Injector(CAMERA, [noise_from(0, 50)], seed=1) for _ in range(2))
    for sequence in range(3):
        first.inject(frame(sequence), 1.0)
    one, injected = first.inject(frame(3), 1.0)
    other, _ = second.inject(frame(3), 1.0)
    assert {kind: one.level for kind, one in injected.items()} == {"noise": 50}
    np.testing.assert_array_equal(one.image, other.image)
    different, _ = Injector(CAMERA, [noise_from(0, 50)], seed=2).inject(frame(3), 1.0)
    assert (different.image != one.image).any()


def test_a_call_overrides_the_schedule_until_it_is_given_back() -> None:
    injector = Injector(CAMERA, [noise_from(0, 50)], seed=1)
    injector.set_level("blur", 30)
    injector.set_level("noise", 0)
    assert injector.levels_at(1) == {"blur": 30}
    injector.set_level("noise", None)
    assert injector.levels_at(1) == {"noise": 50, "blur": 30}


@pytest.mark.parametrize(("kind", "level"), [("snr", 10), ("blur", 101), ("blur", float("nan"))])
def test_an_impossible_call_is_refused(kind: str, level: float) -> None:
    with pytest.raises(SceneError):
        Injector(CAMERA, [], seed=1).set_level(kind, level)


def alone(kind: str, **schedule: Any) -> Injector:
    sensor = RADAR if kind in KINDS["radar"] else CAMERA
    content = {"sensor": sensor.name, "kind": kind, **schedule}
    return Injector(sensor, [Injection.model_validate(content)], seed=1)


def test_a_walk_and_a_burst_are_injected() -> None:
    walk = alone("noise", shape="walk", level=50, spread=20, bounds=[40, 60])
    levels = [walk.levels_at(0.1 * step)["noise"] for step in range(100)]
    assert levels[0] == 50
    assert 40 <= min(levels) < 45 < 55 < max(levels) <= 60
    burst = alone("noise", shape="burst", level=50, duration_s=0.5, period_s=2)
    injected = [list(burst.inject(frame(), t_s)[1]) for t_s in (0.0, 0.6, 2.1)]
    assert injected == [["noise"], [], ["noise"]]


def still(sequence: int) -> Frame:
    """The same image again and again: what changes is what was injected."""
    image = np.full((180, 320, 3), 150, np.uint8)
    image[:, ::2] = 60
    return Frame(image, "camera", sequence, sequence * 40_000_000, "simulated")


def change(injector: Injector, first: int, second: int) -> float:
    images = [injector.inject(still(sequence), 0.0)[0].image for sequence in (first, second)]
    return float(np.abs(images[0].astype(int) - images[1]).mean())


def test_drops_and_dirt_stay_and_fog_drifts_from_frame_to_frame() -> None:
    assert change(alone("drops", level=60), 3, 4) == 0
    assert change(alone("drops", level=60), 3, 170) > 0.1  # wiped away in the meantime
    assert change(alone("dirt", level=60), 3, 1000) == 0
    fog = alone("fog", level=60)
    assert 0 < change(fog, 3, 4) < 0.2 < change(fog, 3, 103)
    assert change(alone("rain", level=60), 3, 4) > 0.1  # falls anew in every frame


def test_the_horizon_of_a_scene_reaches_the_weather() -> None:
    low, high = (alone("fog", level=60, horizon=horizon) for horizon in (0.3, 0.7))
    contrast = [
        injector.inject(still(0), 0.0)[0].image.std(axis=(1, 2)) for injector in (low, high)
    ]
    assert contrast[0][126] > contrast[1][126]


def test_ghosts_live_for_some_scans() -> None:
    scan = WorldRadar(World(2, 3.0)).scan(0)
    before = set(zip(scan.x.tolist(), scan.y.tolist(), strict=True))
    injector = alone("ghosts", level=60, ghost_life=5)
    seen = []
    for sequence in range(30):
        ghosts, _ = injector.inject(replace(scan, sequence=sequence), 0.0)
        seen.append(set(zip(ghosts.x.tolist(), ghosts.y.tolist(), strict=True)) - before)
    assert all(seen[k] == seen[k // 5 * 5] for k in range(30))
    assert len({frozenset(ghosts) for ghosts in seen}) > 3


def test_what_was_injected_is_enough_to_draw_and_apply_it_again() -> None:
    injector = alone("noise", shape="walk", level=50, spread=20)
    message, injected = injector.inject(frame(17), 3.3)
    drawn = injected["noise"]
    assert drawn == camera.draw("noise", drawn.level, DrawKey(1, "camera", 17))
    np.testing.assert_array_equal(camera.apply(drawn, frame(17).image), message.image)
