"""A simulated camera that sees the simulated world."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from drivers.frame import Frame
from models.degrade.draw import DrawKey
from models.world.render.ground import ground_textures, paint_ground
from models.world.render.things import paint_things
from models.world.render.view import View, mount, strip
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
        rng = DrawKey(world.seed, sensor, 0).generator("textures")
        self._ground = ground_textures(rng)

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
        horizon = 0.46 * self.height
        return mount(self.world.ego(t_s), MOUNT_X, MOUNT_Z, self.width, self.height, horizon)

    def frame(self, sequence: int) -> Frame:
        """Return frame ``sequence``."""
        t_s = self.time(sequence)
        image = self._render(t_s)
        noise = DrawKey(self.world.seed, self.sensor, sequence).generator("noise")
        grain = noise.normal(0, 1.5, image.shape).astype(np.float32)
        image = np.clip(np.rint(image + grain), 0, 255).astype(np.uint8)
        return Frame(image, self.sensor, sequence, EPOCH_NS + round(t_s * 1e9), "simulated")

    def _render(self, t_s: float) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
        view = self.view(t_s)
        image = np.empty((self.height, self.width, 3), np.uint8)
        rows = np.arange(self.height, dtype=np.float32)[:, None, None] / view.horizon
        image[:] = np.clip((220, 170, 130) + rows * (20, 55, 90), 0, 255).astype(np.uint8)
        paint_ground(image, view, strip(view, self.world.route), self.world.route, self._ground)
        paint_things(image, view, self.world.objects(t_s))
        return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.6), np.uint8)
