"""Times other libraries' image corruptions; run by another interpreter, imports nothing of murk.

Prints a JSON object a line: library, its name of the corruption, ours, CPU time in ms.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from statistics import median
from time import thread_time
from typing import Any

import cv2
import numpy as np

IMAGECORRUPTIONS = {
    "gaussian_noise": "noise",
    "shot_noise": "poisson",
    "impulse_noise": "salt_pepper",
    "gaussian_blur": "blur",
    "motion_blur": "motion",
    "brightness": "over",
    "fog": "fog",
    "snow": "snow",
    "jpeg_compression": "jpeg",
}
ALBUMENTATIONS: dict[str, tuple[str, dict[str, Any]]] = {
    "GaussNoise": ("noise", {"std_range": (0.2, 0.2)}),
    "ShotNoise": ("poisson", {}),
    "SaltAndPepper": ("salt_pepper", {"amount": (0.1, 0.1)}),
    "GaussianBlur": ("blur", {"blur_limit": (13, 13), "sigma_limit": (2.3, 2.3)}),
    "MotionBlur": ("motion", {"blur_limit": (25, 25)}),
    "RandomBrightnessContrast": ("over", {"brightness_limit": (0.3, 0.3)}),
    "RandomFog": ("fog", {}),
    "RandomRain": ("rain", {}),
    "RandomSnow": ("snow", {}),
    "ImageCompression": ("jpeg", {"quality_range": (20, 20)}),
}


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        return None


def _calls(image: Any) -> Iterator[tuple[str, str, str, Callable[[], Any]]]:
    library = _library("imagecorruptions")
    for name, ours in IMAGECORRUPTIONS.items() if library else ():
        call = partial(library.corrupt, image, corruption_name=name, severity=3)
        yield "imagecorruptions", name, ours, call
    library = _library("albumentations")
    for name, (ours, options) in ALBUMENTATIONS.items() if library else ():
        transform = getattr(library, name)(p=1.0, **options)
        yield "albumentations", name, ours, partial(transform, image=image)


def main(path: str, repeats: int) -> None:
    """Time every corruption on the image that ``path`` (.npy) holds."""
    warnings.simplefilter("ignore")
    cv2.setNumThreads(1)
    image = np.load(path)
    for library, theirs, ours, call in _calls(image):
        record: dict[str, Any] = {"library": library, "theirs": theirs, "ours": ours}
        try:
            call()
            times = []
            for _ in range(repeats):
                start = thread_time()
                call()
                times.append(thread_time() - start)
            record["ms"] = median(times) * 1e3
        except Exception as error:  # another library's fault is a result, too
            record["fault"] = f"{type(error).__name__}: {error}"
        sys.stdout.write(json.dumps(record) + "\n")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
