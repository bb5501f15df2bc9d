from __future__ import annotations

import numpy as np
import pytest

from dbc.errors import SceneError
from drivers.frame import Frame
from node.injector import Injector
from node.scene import Injection, Sensor

CAMERA = Sensor(name="camera", type="camera", source="world")


def frame(sequence: int = 0) -> Frame:
    image = np.random.default_rng(sequence).integers(0, 255, (40, 60, 3), np.uint8)
    return Frame(image, "camera", sequence, sequence * 40_000_000, "simulated")


def noise_from(t_s: float, level: float) -> Injection:
    return Injection(sensor="camera", kind="noise", points=((t_s, level),))


def test_nothing_is_touched_before_the_schedule_begins() -> None:
    injector = Injector(CAMERA, [noise_from(2, 50)], seed=1)
    message, injected = injector.inject(frame(), 1.9)
    assert injected is None
    np.testing.assert_array_equal(message.image, frame().image)


def test_the_same_seed_degrades_the_same_message_alike_whatever_came_before() -> None:
    first, second = (Injector(CAMERA, [noise_from(0, 50)], seed=1) for _ in range(2))
    for sequence in range(3):
        first.inject(frame(sequence), 1.0)
    one, injected = first.inject(frame(3), 1.0)
    other, _ = second.inject(frame(3), 1.0)
    assert injected == {"noise": 50}
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
