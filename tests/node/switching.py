"""Levels and rules for the tests of the switch."""

from __future__ import annotations

from typing import Any

import numpy as np

from models.estimate.level import NoiseLevel
from node.switch_rules import Switch

SECOND = 1_000_000_000

RULES: list[dict[str, Any]] = [
    {"sensor": "camera", "stale_s": 0.5, "model": "radar_only"},
    {"sensor": "radar", "stale_s": 0.5, "model": "camera_only"},
    {"sensor": "camera", "above": 40, "hysteresis": 10, "model": "radar_only"},
    {"sensor": "radar", "above": 60, "hysteresis": 20, "model": "camera_only"},
]


def switch(dwell_s: float = 1.0, rules: list[dict[str, Any]] | None = None) -> Switch:
    content = {"name": "detector", "default": "both", "dwell_s": dwell_s, "rules": rules or RULES}
    return Switch.model_validate(content)


def noise_level(sensor: str, level: float, stamp_ns: int = 0) -> NoiseLevel:
    return NoiseLevel(
        sensor=sensor,
        stamp_ns=stamp_ns,
        level=level,
        std=1.0,
        probabilities=np.full(11, 1 / 11),
        kind="noise",
        kind_probabilities={"noise": 1.0},
        raw=level,
        injected=None,
        latency_ns=0,
        sequence=0,
        dropped=0,
    )
