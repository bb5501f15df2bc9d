"""The sheets of every kind, on the simulated world or on a file."""

from __future__ import annotations

from pathlib import Path

from dbc.errors import LogError
from drivers.camera import open_camera_source
from drivers.frame import Frame
from drivers.scan import RadarScan
from models.evaluate.sheet import draw_camera_sheet, draw_radar_sheet
from models.world.camera import WorldCamera
from models.world.radar import WorldRadar
from models.world.road import World
from node.dataset.sources import SENSOR_TYPE, Source, find_sources
from node.recording import is_recording, open_sensors

_WORLD_SEED, _WORLD_S = 4, 6.0
_FRAME, _SCAN = 90, 45
"""A street with vehicles, houses and trees."""


def draw_sheets(path: Path | None, folder: Path, seed: int) -> list[Path]:
    """Write ``sheet_camera.png`` and ``sheet_radar.png``; return those that were written.

    Parameters
    ----------
    path:
        Of its first image and its first scan; None: of the simulated world.

    Raises
    ------
    InputError
        If the path cannot be read.
    """
    if path is None:
        world = World(_WORLD_SEED, _WORLD_S)
        messages: list[Frame | RadarScan] = [
            WorldCamera(world).frame(_FRAME),
            WorldRadar(world).scan(_SCAN),
        ]
    else:
        sources, _ = find_sources(path)
        firsts = {SENSOR_TYPE[source.form]: source for source in reversed(sources)}
        messages = [_first(source) for source in firsts.values()]
    written = []
    for message in messages:
        if isinstance(message, Frame):
            written.append(folder / "sheet_camera.png")
            draw_camera_sheet(message.image, written[-1], seed)
        else:
            written.append(folder / "sheet_radar.png")
            draw_radar_sheet(message, written[-1], seed)
    return written


def _first(source: Source) -> Frame | RadarScan:
    if is_recording(source.path.name):
        for sensor, recording in open_sensors(source.path):
            if sensor.type == SENSOR_TYPE[source.form]:
                return next(recording.messages())
    if SENSOR_TYPE[source.form] == "camera":
        with open_camera_source(source.path, source.sensor) as frames:
            return next(frames)
    if source.form == "cloud":
        from drivers.nuscenes import read_cloud, scan_of

        return scan_of(read_cloud(source.path), source.sensor, source.sequence, source.path)
    from drivers.ars408_cycles import find_cycles
    from drivers.can_frames import concatenate
    from drivers.candump import read_candump

    for cycle in find_cycles(concatenate(list(read_candump(source.path)))):
        return cycle.scan
    raise LogError(source.path, "holds no cluster scan", "expected CAN IDs 0x600 and 0x701")
