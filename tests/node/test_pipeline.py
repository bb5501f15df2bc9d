from __future__ import annotations

from pathlib import Path
from threading import Event, Thread
from typing import Any

import cv2
import numpy as np
import pytest

from dbc.errors import InputError, SceneError
from models.estimate.level import NoiseLevel
from node.bus.in_process import Bus
from node.pipeline import Pipeline
from node.plan import plan
from node.scene import check_scene

IMAGES = 12


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of street-like pictures: soft shapes, a horizon, some texture."""
    path = tmp_path_factory.mktemp("frames")
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.normal(0, 40, (240, 320, 3)), (0, 0), 1.5)
    base = np.linspace(200, 60, 240)[:, None, None] + texture
    for number in range(IMAGES):
        image = np.clip(np.roll(base, 4 * number, axis=1), 0, 255).astype(np.uint8)
        cv2.imwrite(str(path / f"{number:03}.png"), image)
    return path


def pipeline(bus: Bus, *sensors: dict[str, Any], **content: Any) -> Pipeline:
    return Pipeline(plan(check_scene({"sensors": sensors, **content}, "test")), bus)


def camera(source: object) -> dict[str, Any]:
    return {"name": "camera", "type": "camera", "source": str(source)}


RADAR = {"name": "radar", "type": "radar", "source": "world"}
NOISE = {"sensor": "camera", "kind": "noise", "level": 80}
SNR = {"sensor": "radar", "kind": "snr", "level": 60}


def key(level: NoiseLevel) -> tuple[object, ...]:
    return (level.sensor, level.sequence, level.stamp_ns, level.level, level.std, level.raw)


def test_every_message_becomes_a_level_and_carries_its_history(folder: Path) -> None:
    with Bus() as bus:
        made = pipeline(bus, camera(folder), injections=[NOISE], clock={"fast": True})
        levels = list(made.run())
        assert [level.sequence for level in levels] == list(range(IMAGES))
        assert all(level.injected == {"noise": 80} for level in levels)
        assert all(level.dropped == 0 and level.latency_ns > 0 for level in levels)
        assert all(abs(level.probabilities.sum() - 1) < 1e-9 for level in levels)
        assert bus.latest("/murk/camera/noise_level") is levels[-1]
        assert bus.latest("/murk/camera/image").sequence == IMAGES - 1
        counts = made.summary()["sensors"]["camera"]
        assert counts["received"] == counts["estimated"] == IMAGES


def test_the_same_seed_gives_the_same_levels_in_the_same_order(folder: Path) -> None:
    def levels(seed: int) -> list[tuple[object, ...]]:
        with Bus() as bus:
            content = {"injections": [NOISE, SNR], "clock": {"fast": True}}
            made = pipeline(bus, camera(folder), RADAR, seed=seed, duration_s=1.0, **content)
            return [key(level) for level in made.run()]

    once = levels(3)
    assert once == levels(3)
    assert once != levels(4)
    assert {row[0] for row in once} == {"camera", "radar"}


def test_duration_and_loop(folder: Path) -> None:
    with Bus() as bus:
        clock = {"fast": True, "loop": True}
        made = pipeline(bus, camera(folder), clock=clock, duration_s=3.0)
        levels = list(made.run())
    assert [level.sequence for level in levels] == list(range(30))
    assert set(np.diff([level.stamp_ns for level in levels])) == {100_000_000}


def test_real_time_is_kept_and_a_stop_ends_the_run(folder: Path) -> None:
    with Bus() as bus:
        made = pipeline(bus, camera(folder), clock={"loop": True, "speed": 5})
        levels = []
        for level in made.run():
            levels.append(level)
            if len(levels) == 20:
                made.stop()
        span_s = made.summary()["wall_time_s"]
    assert len(levels) >= 20
    assert span_s > 0.3  # twenty frames of 10 Hz at five times real time


def test_a_subscriber_that_hangs_does_not_hold_the_run_up(folder: Path) -> None:
    release = Event()
    with Bus() as bus:
        bus.subscribe("/murk/camera/noise_level", lambda level: release.wait(30))
        made = pipeline(bus, camera(folder), clock={"fast": True})
        assert len(list(made.run())) == IMAGES
        release.set()


def test_injection_can_be_changed_while_running(folder: Path) -> None:
    with Bus() as bus:
        idle = {**NOISE, "level": 0}
        made = pipeline(bus, camera(folder), clock={"loop": True, "speed": 5}, injections=[idle])
        seen = []
        for level in made.run():
            seen.append(level.injected)
            if len(seen) == 3:
                made.set_injection("camera", "noise", 70)
            if level.injected == {"noise": 70} or len(seen) > 200:
                made.stop()
        assert seen[0] is None
        assert {"noise": 70} in seen
        with pytest.raises(SceneError, match="no sensor"):
            made.set_injection("lidar", "noise", 1)


def test_a_run_that_is_left_early_ends_its_threads(folder: Path) -> None:
    with Bus() as bus:
        made = pipeline(bus, camera(folder), clock={"fast": True, "loop": True})
        run = made.run()
        next(run)
        closer = Thread(target=run.close)
        closer.start()
        closer.join(20)
        assert not closer.is_alive()


@pytest.mark.parametrize(
    ("sensor", "expected"),
    [
        (camera("absent.mp4"), "absent.mp4"),
        ({"name": "radar", "type": "radar", "source": "absent.log"}, "absent.log"),
    ],
)
def test_a_missing_recording_is_one_line(sensor: dict[str, Any], expected: str) -> None:
    with Bus() as bus, pytest.raises(InputError, match=expected):
        list(pipeline(bus, sensor, clock={"fast": True}).run())


def test_a_log_without_this_radar_says_so(tmp_path: Path) -> None:
    log = tmp_path / "other.log"
    log.write_text("(1.000000) can0 123#00\n(1.100000) can0 123#01\n")
    sensor = {"name": "radar", "type": "radar", "source": str(log)}
    with Bus() as bus, pytest.raises(InputError, match="no cluster scan of SensorID 0"):
        list(pipeline(bus, sensor, clock={"fast": True}).run())
