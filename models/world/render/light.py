"""The light of one drive: sun, sky and haze.

The canvas holds coded radiance: 8 bits, roughly the square root of the light. 190 is white paint
in the sun; what is brighter may clip. The lens (``lens.py``) makes a camera's picture of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from models.world.objects import Floats
from models.world.render.textures import Image

Colour = tuple[float, float, float]
"""Blue, green, red, coded radiance 0–255."""


@dataclass(frozen=True, slots=True)
class Light:
    """Sun, sky and haze.

    Attributes
    ----------
    sun:
        Unit vector to the sun in world axes (x, y, up).
    direct:
        Share of the light that comes from the sun directly, 0 under clouds.
    haze_m:
        Distance at which 63 % of the contrast is lost, m.
    zenith, horizon:
        Colours of the sky.
    """

    sun: tuple[float, float, float]
    direct: float
    haze_m: float
    zenith: Colour
    horizon: Colour

    def on(self, nx: Floats, ny: Floats, nz: Floats) -> Floats:
        """Return the factor on coded radiance of faces with these world normals, 0 to about 1."""
        toward = np.maximum(nx * self.sun[0] + ny * self.sun[1] + nz * self.sun[2], 0)
        sky = (1 - self.direct) * (0.65 + 0.35 * nz) * 0.9 + 0.1
        result: Floats = np.sqrt(sky + self.direct * toward)
        return result

    def hazed(self, colour: Floats, distance: Floats) -> Floats:
        """Return colours (..., 3) as seen through ``distance`` (...) m of air."""
        share = 1 - np.exp(-np.asarray(distance) / self.haze_m)[..., None]
        result: Floats = colour * (1 - share) + np.asarray(self.horizon) * share
        return result

    def through_haze(self, image: Image, lit: float, distance: float) -> Image:
        """Return a picture lit by a factor and seen through ``distance`` m of air."""
        share = 1 - float(np.exp(-distance / self.haze_m))
        lit_picture = cv2.convertScaleAbs(image, alpha=lit * (1 - share))
        veil = np.array([*(share * c for c in self.horizon), 0.0])
        return np.asarray(cv2.add(lit_picture, veil), np.uint8)


def draw_light(rng: np.random.Generator) -> Light:
    """Return the light of a random day: mostly sunny, sometimes overcast."""
    around, above = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(18, 60))
    sun = (
        float(np.cos(around) * np.cos(above)),
        float(np.sin(around) * np.cos(above)),
        float(np.sin(above)),
    )
    overcast = rng.random() < 0.3
    gray = rng.uniform(0.85, 1.05)
    zenith = (205.0, 200.0, 196.0) if overcast else (188.0, 138.0, 92.0)
    horizon = (232.0, 230.0, 228.0) if overcast else (232.0, 218.0, 200.0)
    return Light(
        sun=sun,
        direct=rng.uniform(0.0, 0.15) if overcast else rng.uniform(0.5, 0.75),
        haze_m=rng.uniform(500, 1500),
        zenith=tuple(gray * c for c in zenith),  # type: ignore[arg-type]
        horizon=tuple(min(gray * c, 250.0) for c in horizon),  # type: ignore[arg-type]
    )
