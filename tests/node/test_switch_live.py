"""The switch in a run in real time: models warm before the first level, staleness, a detector."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import cv2
import numpy as np
import pytest

from node.bus.in_process import Bus
from node.events import MODEL_TOPIC, ModelChoice
from node.outputs import open_outputs
from node.pipeline import Pipeline
from node.plan import plan
from node.scene import Scene, check_scene
from node.subscribe import subscribe
from node.switch import ModelSwitch

PAGE = Path(__file__).resolve().parents[2] / "docs" / "switch.md"
PATIENCE_S = 60.0
RADAR = {"name": "radar", "type": "radar", "source": "world"}
CAMERA = {"name": "camera", "type": "camera", "source": "world"}
BLIND = {"sensor": "camera", "above": 40, "hysteresis": 10, "model": "radar_only"}


def scene(camera: dict[str, str], stale_s: float, **content: Any) -> Scene:
    silent = {"sensor": "camera", "stale_s": stale_s, "model": "radar_only"}
    rules = {"name": "detector", "default": "camera_first", "rules": [silent, BLIND]}
    return check_scene({"sensors": [camera, RADAR], "switches": [rules], **content}, "test")


class Run:
    """A scene that runs beside the test; what its switch chose is in ``choices`` at the end."""

    def __init__(self, running: Scene, bus: Bus) -> None:
        self.choices: list[ModelChoice] = []
        self._bus = bus
        self._kept = plan(running)
        self._thread = Thread(target=self._run, daemon=True)

    def __enter__(self) -> Run:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()

    def _run(self) -> None:
        listener = self._bus.subscribe(MODEL_TOPIC, self.choices.append)
        pipeline = Pipeline(self._kept, self._bus)
        with open_outputs(self._kept, self._bus, pipeline.set_injection):
            for _ in pipeline.run():
                pass
        listener.close()
        listener.join(PATIENCE_S)
        self._bus.close()


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """Return a folder of pictures, less than a second of them."""
    rng = np.random.default_rng(0)
    for number in range(8):
        texture = cv2.GaussianBlur(rng.normal(128, 60, (120, 160, 3)), (0, 0), 1.5)
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.clip(texture, 0, 255).astype(np.uint8))
    return tmp_path


def test_a_camera_that_ends_is_stale_and_the_fallback_takes_over(pictures: Path) -> None:
    silent_camera = {"name": "camera", "type": "camera", "source": str(pictures)}
    built: list[object] = []

    def model(name: str) -> Any:
        return lambda: (built.append(bus.latest("/murk/camera/noise_level")), name)[1]

    with Bus() as bus:
        running = scene(silent_camera, stale_s=0.4, duration_s=4.0)
        own = ModelSwitch(
            running.switches[0], {name: model(name) for name in ("camera_first", "radar_only")}
        )
        assert built == [None, None]  # both were there before the first level
        levels = subscribe(bus, ["camera"])
        with Run(running, bus) as run:
            own.follow(levels)
    assert run.choices[-1].model == own.model == "radar_only"
    assert "camera is stale" in run.choices[-1].reason
    assert len(built) == 2


def test_the_page_shows_a_detector_that_works() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, Any] = {}
    exec(code, names)
    under = {"sensor": "camera", "kind": "under", "points": [[1.5, 90]]}
    with Bus() as bus:
        running = scene(CAMERA, stale_s=60.0, duration_s=4.0, seed=3, injections=[under])
        answers: Iterator[tuple[str, Any]] = names["detect"](bus, running.switches[0])
        with Run(running, bus):
            models, places = zip(*answers, strict=True)
    assert models[0] == "camera_first"
    assert models[-1] == "radar_only"
    assert all(found.ndim == 2 and found.shape[1] == 2 for found in places)
    assert any(len(found) for found in places)
