"""Degradations of camera frames and radar scans: draw the parameters, then apply them.

Every module of ``MODULES`` has ``KINDS``, ``draw(kind, level, key)`` and ``apply(drawn, message)``,
where the message is an image or a ``RadarScan``.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

MODULES = {"camera": ("camera", "imager", "weather"), "radar": ("radar", "jammer", "propagation")}
"""Modules of this package by sensor type; none is imported before ``load``."""


def load(sensor_type: str) -> dict[str, Any]:
    """Return the module of each kind that a sensor of this type can have, by kind."""
    modules = [import_module(f"models.degrade.{name}") for name in MODULES[sensor_type]]
    return {kind: module for module in modules for kind in module.KINDS}
