"""What a camera degradation would give in exact arithmetic: float64, neither rounded nor clipped.

For the kinds that are a law of light; the others are defined by their own integer steps.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from models.degrade import camera, haze, imager, weather

Image = NDArray[np.uint8]
Exact = NDArray[np.float64]


def exact(drawn: Any, image: Image) -> Exact:
    """Return the exact result, (height, width, 3).

    Parameters
    ----------
    drawn:
        Blur, exposure, motion, tunnel, or the even haze of fog, rain or snow.
    image:
        (height, width, 3) uint8.

    Raises
    ------
    KeyError
        If the degradation is another one.
    """
    match drawn:
        case camera.Blur():
            return _blurred(drawn, image.astype(np.float64))
        case camera.Exposure():
            kernel = np.array([0.25, 0.5, 0.25])
            light = image.astype(np.float64)
            spread = cv2.sepFilter2D(light, -1, kernel, kernel, borderType=cv2.BORDER_REFLECT_101)
            return np.asarray(spread * drawn.gain)
        case imager.Motion():
            return _smeared(drawn, image.astype(np.float32))
        case imager.Gain(gain=gain):
            return np.asarray(image * gain)
        case weather.Weather(haze=haze.Haze(patchiness=0) as air):
            depth = haze.default_depth(image.shape[0], drawn.horizon)[:, None, None]
            through = np.exp(-air.extinction * depth)
            airlight = air.airlight * haze.scene_light(image, drawn.horizon)
            return np.asarray(image * through + airlight * (1 - through))
        case _:
            raise KeyError(drawn.kind)


def _blurred(blur: camera.Blur, light: Exact) -> Exact:
    if blur.sigma == 0:
        return light
    size = (blur.size, blur.size)
    blurred = cv2.GaussianBlur(light, size, blur.sigma, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(blurred)


def _smeared(motion: imager.Motion, light: NDArray[np.float32]) -> Exact:
    """Return the mean of 256 bilinear samples along the smear."""
    angle = np.radians(motion.direction_deg)
    total = np.zeros(light.shape)
    for share in (np.arange(256) + 0.5) / 256 - 0.5:
        x, y = share * motion.length * np.cos(angle), share * motion.length * np.sin(angle)
        shift = np.array([[1, 0, x], [0, 1, y]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        total += cv2.warpAffine(
            light, shift, light.shape[1::-1], flags=flags, borderMode=cv2.BORDER_REFLECT
        )
    return total / 256
