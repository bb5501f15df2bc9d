"""The card of the detector of road users: what it is, what it saw, what it reaches."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from models.bev.camera_first import CameraFirst
from models.bev.ospa import CUTOFF_M, ospa
from models.bev.picture import horizon_of
from models.bev.radar_only import RadarOnly
from models.bev.truth import FARTHEST_M, truth
from models.world.camera import WorldCamera
from models.world.objects import Floats
from models.world.radar import WorldRadar
from models.world.road import World

_FIRST_SEED = 2_100_000
_DURATION_S = 20.0
_RATE_HZ = 1.0

_CARD = """\
# Road users in the camera's picture

Tells where vehicles and pedestrians are, as an example of a detector that the noise levels switch
off: see `docs/switch.md`. It is made for the simulated world and for nothing else.

- Input `picture`: (1, 3, 128, 320) float32, BGR counts, as `models.bev.picture.strip` cuts it.
- Output `answer`: (1, 3, 32, 80) for cells of 4 × 4 pixels: score (logit), logarithm of the depth
  over 15 m, and cells to the right of the cell's middle.
- {parameters:,} parameters; {frames:,} clean frames of {worlds} simulated drives (Apache-2.0).
- Reproduce: `python -m models.training.bev bev_camera.onnx`; seed {seed}.

## Measured

{drives} drives that no training saw, {rate:g} frame a second, road users up to {farthest:g} m ahead
of the camera: mean OSPA distance of order 1, cut-off {cutoff:g} m.

| | m |
|---|---|
| `CameraFirst`: this network, confirmed by the radar | {camera:.2f} |
| `RadarOnly`, which has no network | {radar:.2f} |
| reporting nothing | {nothing:.2f} |
"""


def write_card(
    path: Path, *, parameters: int, frames: int, worlds: int, seed: int, drives: int
) -> None:
    """Measure the network of an ONNX file on ``drives`` drives, and write its card beside it."""
    camera, radar, nothing = measure(path, drives).mean(axis=0)
    text = _CARD.format(
        parameters=parameters,
        frames=frames,
        worlds=worlds,
        seed=seed,
        drives=drives,
        rate=_RATE_HZ,
        farthest=FARTHEST_M,
        cutoff=CUTOFF_M,
        camera=camera,
        radar=radar,
        nothing=nothing,
    )
    path.with_suffix(".md").write_text(text, encoding="utf-8")


def measure(path: Path, drives: int) -> Floats:
    """Return the OSPA of both detectors and of reporting nothing, a row a frame, (n, 3) m."""
    rows = []
    for seed in range(_FIRST_SEED, _FIRST_SEED + drives):
        world = World(seed, _DURATION_S)
        camera, radar = WorldCamera(world, rate_hz=_RATE_HZ), WorldRadar(world)
        both = (CameraFirst(horizon_of(camera), path=path), RadarOnly())
        for frame in camera.frames():
            t_s = camera.time(frame.sequence)
            scan = radar.scan(max(0, int(t_s / radar.description.cycle_s) - 1))
            right = truth(world, camera.view(t_s), t_s)
            answers = [*(find(frame, scan) for find in both), np.empty((0, 2))]
            rows.append([ospa(answer, right) for answer in answers])
    return np.array(rows)
