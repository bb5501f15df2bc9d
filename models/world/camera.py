"""A simulated camera that sees the simulated world."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drivers.frame import Frame
from models.degrade.draw import DrawKey
from models.world.render.lens import draw_lens, expose
from models.world.render.scene import Scenery, paint
from models.world.render.view import View, mount
from models.world.road import EPOCH_NS, World

MOUNT_X, MOUNT_Z = 1.7, 1.45
"""Place of the camera: ahead of the middle of the rear axle, and above the ground, m."""


class WorldCamera:
    """The camera of one drive; frame k is the same whoever asks for it, and in whatever order.

    Parameters
    ----------
    world:
        What it sees.
    sensor:
        Its name in the scene.
    width, height:
        Of the image, pixels.
    rate_hz:
        Frames a second.
    """

    def __init__(
        self,
        world: World,
        sensor: str = "camera",
        width: int = 960,
        height: int = 540,
        rate_hz: float = 12.5,
    ) -> None:
        self.world = world
        self.sensor = sensor
        self.width = width
        self.height = height
        self.rate_hz = rate_hz
        draw = DrawKey(world.seed, sensor, 0)
        self._scenery = Scenery(draw.generator("scenery"))
        self._lens = draw_lens(draw.generator("lens"), width * height * 3)
        self._horizon = float(draw.generator("mount").uniform(0.40, 0.52)) * height

    def frames(self) -> Iterator[Frame]:
        """Yield every frame of the drive."""
        sequence = 0
        while self.time(sequence) < self.world.duration_s:
            yield self.frame(sequence)
            sequence += 1

    def time(self, sequence: int) -> float:
        """Return when frame ``sequence`` is taken, s from the start."""
        return sequence / self.rate_hz

    def view(self, t_s: float) -> View:
        """Return the camera's pose and projection at ``t_s`` seconds from the start."""
        ego = self.world.ego(t_s)
        shake = 0.0012 * self.width * np.sin(9.0 * ego.s / 10) * min(ego.speed / 10, 1.0)
        horizon = self._horizon + float(shake)
        return mount(ego, MOUNT_X, MOUNT_Z, self.width, self.height, horizon)

    def frame(self, sequence: int) -> Frame:
        """Return frame ``sequence``."""
        t_s = self.time(sequence)
        canvas = paint(self.world, self._scenery, self.view(t_s), t_s)
        rng = DrawKey(self.world.seed, self.sensor, sequence).generator("noise")
        image = expose(canvas, self._lens, rng)
        return Frame(image, self.sensor, sequence, EPOCH_NS + round(t_s * 1e9), "simulated")
