"""The plan: which stages a scene needs, and why each other one is left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from drivers.camera import IMAGE_SUFFIXES
from node.recording import is_recording, split_source
from node.scene import WORLD, Scene, Sensor
from node.sources import is_can_bus


@dataclass(frozen=True, slots=True)
class Stage:
    """One stage of the pipeline.

    Attributes
    ----------
    name:
        What it does: ``source``, ``inject``, ``estimate``, ``pace``, ``world``, ``picture``, or
        the sensor type that no sensor has.
    sensor:
        The sensor it serves; None where it serves the whole scene.
    kept:
        Whether the scene needs it.
    reason:
        Why it is kept or left out.
    libraries:
        Import names of the libraries that it loads.
    """

    name: str
    sensor: str | None
    kept: bool
    reason: str
    libraries: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Plan:
    """All stages of a scene, kept and left out."""

    scene: Scene
    stages: tuple[Stage, ...]

    def keeps(self, name: str, sensor: str | None = None) -> bool:
        """Tell whether a stage is kept."""
        return any(
            stage.kept and stage.name == name and stage.sensor == sensor for stage in self.stages
        )

    @property
    def libraries(self) -> list[str]:
        """Import names of the libraries that the kept stages load, sorted."""
        return sorted({name for stage in self.stages if stage.kept for name in stage.libraries})


def plan(scene: Scene) -> Plan:
    """Decide which stages a scene needs."""
    stages = [stage for sensor in scene.sensors for stage in _sensor_stages(scene, sensor)]
    return Plan(scene, (*stages, *_scene_stages(scene)))


def _sensor_stages(scene: Scene, sensor: Sensor) -> Iterator[Stage]:
    reason, libraries = _source(sensor)
    yield Stage("source", sensor.name, True, reason, libraries)
    if sensor.type == "radar":
        reason = f"motion of {sensor.motion}" if sensor.motion else "the scene asks for none"
        yield Stage("motion input", sensor.name, bool(sensor.motion), reason, ("cantools",))
    kinds = [injection.kind for injection in scene.injections if injection.sensor == sensor.name]
    yield Stage(
        "inject",
        sensor.name,
        bool(kinds),
        f"injections: {', '.join(kinds)}" if kinds else "no injection names this sensor",
        ("cv2",) if sensor.type == "camera" else (),
    )
    yield Stage(
        "estimate",
        sensor.name,
        True,
        _effort(sensor),
        ("cv2", "onnxruntime") if sensor.type == "camera" else ("onnxruntime",),
    )


def _effort(sensor: Sensor) -> str:
    """Return why the sensor is estimated, and how."""
    reason = "its noise level is published"
    if sensor.calibration:
        reason += f", corrected by {sensor.calibration.name}"
    if sensor.adaptive and sensor.type == "camera":
        reason += "; a quarter of the reading while certain, fewer frames while steady"
    elif sensor.adaptive:
        reason += "; every second scan while certain and steady"
    return reason


def _source(sensor: Sensor) -> tuple[str, tuple[str, ...]]:
    """Return what the source is, and the libraries that read it."""
    path = Path(sensor.source)
    if sensor.source == WORLD:
        return "the simulated world", ("cv2",) if sensor.type == "camera" else ("cantools",)
    if is_recording(sensor.source):
        decoder = ("cv2",) if sensor.type == "camera" else ()
        return f"recording {split_source(sensor.source)[0].name}", ("mcap", "rosbags", *decoder)
    if sensor.type == "radar":
        if is_can_bus(sensor.source):
            return f"CAN bus {sensor.source}", ("cantools", "can")
        return f"CAN log {path.name}", ("cantools",)
    if path.is_dir() or path.suffix.lower() in IMAGE_SUFFIXES:
        return f"images {path.name}", ("cv2",)
    if path.is_file():
        return f"video file {path.name}", ("av",)
    return f"camera {sensor.source}", ("cv2",)


def _scene_stages(scene: Scene) -> Iterator[Stage]:
    simulated = [sensor.name for sensor in scene.sensors if sensor.source == WORLD]
    yield Stage(
        "world",
        None,
        bool(simulated),
        f"sees {', '.join(simulated)}" if simulated else "no sensor's source is the world",
    )
    yield Stage(
        "pace",
        None,
        not scene.clock.fast,
        "as fast as possible" if scene.clock.fast else f"{scene.clock.speed:g} × real time",
    )
    for missing in ("camera", "radar"):
        if all(sensor.type != missing for sensor in scene.sensors):
            yield Stage(missing, None, False, f"the scene has no {missing}")
    if scene.faults:
        yield Stage("faults", None, False, "only murk gateway makes them")
    yield from _output_stages(scene)
    picture = scene.outputs.picture
    yield Stage(
        "picture",
        None,
        picture is not None,
        f"written to {picture}" if picture else "the scene asks for none",
        ("matplotlib",),
    )


def _output_stages(scene: Scene) -> Iterator[Stage]:
    names = ", ".join(switch.name for switch in scene.switches)
    yield Stage("switch", None, bool(names), names or "the scene has none")
    outputs = scene.outputs
    record, can, view = outputs.record, outputs.can, outputs.view
    none = "the scene asks for none"
    reason = f"recorded in {record.path}" if record else none
    yield Stage("record", None, record is not None, reason, ("mcap", "rosbags"))
    reason = "levels over DDS" if outputs.ros2 else none
    yield Stage("ros2", None, outputs.ros2 is not None, reason, ("cyclonedds", "rosbags"))
    reason = f"levels on {can.bus}" if can else none
    yield Stage("can", None, can is not None, reason, ("can", "cantools"))
    reason = f"a page on {view.host}:{view.port}" if view else none
    yield Stage("view", None, view is not None, reason, ("aiohttp",))
