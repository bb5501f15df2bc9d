"""What a gateway is to do, from a scene file or from flags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dbc.errors import SceneError
from node.scene import (
    Injection,
    Scene,
    Sensor,
    SensorType,
    check_scene,
    parse_injection,
    read_scene_file,
)


@dataclass(frozen=True, slots=True)
class GatewayScene:
    """One sensor, and what a gateway does to it.

    Attributes
    ----------
    sensor:
        The sensor; its source is the gateway's input.
    injections, faults:
        Schedules; a fault's level is its rate in %.
    seed:
        Of injections and faults.
    duration_s:
        When to stop, seconds after the start; None: at the end of the input.
    """

    sensor: Sensor
    injections: tuple[Injection, ...] = ()
    faults: tuple[Injection, ...] = ()
    seed: int = 0
    duration_s: float | None = None


def build_gateway_scene(
    scene_file: Path | None,
    sensor_type: SensorType,
    source: str,
    *,
    name: str | None = None,
    sensor_id: int | None = None,
    inject: Sequence[str] = (),
    fault: Sequence[str] = (),
    seed: int | None = None,
    duration_s: float | None = None,
) -> GatewayScene:
    """Build what a gateway does from a scene file and flags; a flag goes before the file.

    Without a scene file there is one sensor, named after its type unless ``name`` names it. A
    scene file may have further sensors; ``name`` chooses where there are several of the type.

    Parameters
    ----------
    source:
        The gateway's input, whatever source the file names.
    inject:
        ``SENSOR:KIND:LEVEL`` each.
    fault:
        ``FAULT:RATE`` each.

    Raises
    ------
    SceneError
        If the file cannot be read, or file or flags are wrong.
    """
    content: dict[str, Any] = read_scene_file(scene_file) if scene_file else {}
    where = scene_file or "flags"
    if scene_file is None:
        content["sensors"] = [
            {
                "name": sensor_type if name is None else name,
                "type": sensor_type,
                "source": source,
                "sensor_id": sensor_id or 0,
            }
        ]
    flags = {"seed": seed, "duration_s": duration_s}
    content |= {key: value for key, value in flags.items() if value is not None}
    content["injections"] = [*content.get("injections", []), *map(parse_injection, inject)]
    sensor = _choose(check_scene(content, where), sensor_type, name, where)
    given = [_parse_fault(flag, sensor.name) for flag in fault]
    scene = check_scene(content | {"faults": [*content.get("faults", []), *given]}, where)
    changes: dict[str, Any] = {"source": source}
    if sensor_id is not None:
        changes["sensor_id"] = sensor_id
    return GatewayScene(
        sensor=sensor.model_copy(update=changes),
        injections=tuple(one for one in scene.injections if one.sensor == sensor.name),
        faults=tuple(one for one in scene.faults if one.sensor == sensor.name),
        seed=scene.seed,
        duration_s=scene.duration_s,
    )


def _choose(scene: Scene, sensor_type: SensorType, name: str | None, where: object) -> Sensor:
    """Return the scene's sensor that the gateway serves."""
    sensors = [one for one in scene.sensors if one.type == sensor_type]
    chosen = [one for one in sensors if name in (None, one.name)]
    if len(chosen) == 1:
        return chosen[0]
    names = ", ".join(one.name for one in sensors)
    if not sensors:
        raise SceneError(where, f"has no {sensor_type}", "a gateway serves one of the scene's")
    if chosen:
        raise SceneError(where, f"has several {sensor_type}s", f"choose with --sensor: {names}")
    raise SceneError(f"--sensor {name}", f"is no {sensor_type} of the scene", f"it has {names}")


def _parse_fault(flag: str, sensor: str) -> dict[str, Any]:
    try:
        kind, rate = flag.split(":")
        return {"sensor": sensor, "kind": kind, "level": float(rate)}
    except ValueError:
        expected = "expected FAULT:RATE, for example drop:5"
        raise SceneError(f"--fault {flag}", "is not a fault", expected) from None
