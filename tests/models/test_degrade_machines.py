"""The same bytes on processors with and without wide instructions."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
import sys

import cv2
import numpy as np
import pytest

from models.degrade.draw import DrawKey
from models.degrade.kinds import KINDS, module_of
from models.evaluate.radar import simulated_drive

_LEVELS = (0.7, 10.0, 33.0, 61.0, 90.0)


def _digests() -> str:
    """Return the digest of every kind's results, a line a kind."""
    values = np.random.default_rng(0).integers(0, 256, (180, 320, 3), dtype=np.uint8)
    image = cv2.GaussianBlur(values, (5, 5), 1.0)
    scans = simulated_drive(1, 0, 3).scans
    lines = []
    for sensor_type, inputs in (("camera", [image]), ("radar", scans)):
        for kind in KINDS[sensor_type]:
            module, digest = module_of(sensor_type, kind), hashlib.sha256()
            for level in _LEVELS:
                for sequence, data in enumerate(inputs):
                    key = DrawKey(2, sensor_type, sequence)
                    result = module.apply(module.draw(kind, level, key), data)
                    fields = (
                        [result] if sensor_type == "camera" else [result.x, result.y, result.vx]
                    )
                    for field in fields:
                        digest.update(np.ascontiguousarray(field).tobytes())
            lines.append(f"{sensor_type} {kind} {digest.hexdigest()}")
    return "\n".join(lines)


def _narrow() -> dict[str, str]:
    """Return the environment in which neither library takes an instruction set it found."""
    found = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    return {"NPY_DISABLE_CPU_FEATURES": " ".join(found), "OPENCV_CPU_DISABLE": "AVX2,FMA3,AVX"}


@pytest.mark.skipif(platform.machine() != "x86_64", reason="switches of x86 processors")
def test_every_kind_gives_the_same_bytes_without_wide_instructions() -> None:
    ran = subprocess.run(
        [sys.executable, __file__],
        env=os.environ | _narrow(),
        capture_output=True,
        text=True,
        check=True,
    )
    assert ran.stdout.split("\n") == _digests().split("\n")


if __name__ == "__main__":
    sys.stdout.write(_digests())
