"""What the benchmarks of degradation work on: an image and a scan, always the same."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.sensor import ARS408

HEIGHT, WIDTH = 900, 1600
"""Of the image, pixels."""


def textured_image(height: int = HEIGHT, width: int = WIDTH) -> NDArray[np.uint8]:
    """Return an image with power at every scale, as photographs have; always the same."""
    random = np.random.default_rng(1)
    image = np.full((height, width, 3), 110.0, np.float32)
    for octave in (2, 4, 8, 16, 32, 64):
        shape = (height // octave + 2, width // octave + 2, 3)
        coarse = random.normal(0, 7 * octave**0.5, shape).astype(np.float32)
        image += cv2.resize(coarse, (width, height))
    return np.clip(image, 0, 255).astype(np.uint8)


def full_scan() -> RadarScan:
    """Return a scan of 250 clusters along a road, a quarter of them moving, without quality."""
    n = ARS408.max_clusters
    random = np.random.default_rng(1)
    distance = np.sort(random.gamma(3.0, 18.0, n))
    azimuth = random.normal(0, 0.35, n)
    rows = np.array(
        [
            distance * np.cos(azimuth),
            distance * np.sin(azimuth),
            random.normal(-8, 6, n),
            np.zeros(n),
            -5 + random.exponential(10, n),
        ]
    )
    x, y, vx, vy, rcs = ARS408.rows_to_grid(rows).astype(np.float32)
    return RadarScan(
        sensor="bench",
        sensor_id=0,
        sequence=0,
        stamp_ns=0,
        stamp_source="simulated",
        mode="cluster",
        meas_counter=0,
        near=n,
        far=0,
        id=np.arange(n, dtype=np.uint8),
        x=x,
        y=y,
        vx=vx,
        vy=vy,
        rcs=rcs,
        dyn_prop=np.where(np.arange(n) % 4, 1, 0).astype(np.uint8),
    )
