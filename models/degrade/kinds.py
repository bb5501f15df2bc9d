"""Every kind of degradation by sensor type, and the module that draws and applies it.

The names stand here so that a scene is checked without loading OpenCV; the module of a kind is
imported when the kind is first needed. Each module has ``draw(kind, level, key)`` and
``apply(drawn, data)``, where data is an image or a ``RadarScan``:

- ``kind`` is one of the module's ``KINDS``;
- ``level`` is 0 to 100 %; 0 is the identity;
- ``key``, a ``DrawKey``, is what the draw depends on, and nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import ModuleType
from typing import Any

_MODULES = {
    "camera": {
        "camera": ("blur", "over", "under", "noise"),
        "imager": ("motion", "tunnel", "poisson", "salt_pepper", "low_light", "jpeg", "dead"),
        "weather": ("fog", "rain", "snow", "drops", "dirt"),
    },
    "radar": {
        "radar": ("snr", "ghosts", "missed", "jitter"),
        "jammer": ("noise_jam", "interference", "deception"),
        "propagation": ("multipath", "blockage", "misalignment"),
    },
}

KINDS = {
    sensor_type: tuple(kind for kinds in modules.values() for kind in kinds)
    for sensor_type, modules in _MODULES.items()
}
"""Kinds that can be injected, by sensor type: ``camera`` or ``radar``."""

HAZY = ("fog", "rain", "snow")
"""Kinds that depend on depth: ``apply`` takes ``depth_m``."""

OPTIONS = {
    "horizon": HAZY,
    "ghost_life": ("snr", "ghosts"),
    "snr_drop_db": _MODULES["radar"]["radar"],
    "quality": _MODULES["radar"]["radar"],
    "method": _MODULES["camera"]["camera"],
    "std_max": ("noise",),
}
"""What else ``draw`` takes, and of which kinds; see there."""


def options_of(kind: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of some options (by name) that the kind's ``draw`` takes."""
    return {name: value for name, value in options.items() if kind in OPTIONS[name]}


def module_of(sensor_type: str, kind: str) -> ModuleType:
    """Import and return the module that draws and applies a kind.

    Raises
    ------
    KeyError
        If there is no such sensor type or kind.
    """
    for name, kinds in _MODULES[sensor_type].items():
        if kind in kinds:
            return import_module(f"models.degrade.{name}")
    raise KeyError(kind)
