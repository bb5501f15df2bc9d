"""Times other libraries' image corruptions; run by another interpreter, imports nothing of murk.

Prints a JSON object a line, in the order of ``PAIRS``: CPU time in ms, or what failed.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable
from functools import partial
from importlib import import_module
from statistics import median
from time import thread_time
from typing import Any, NamedTuple

import cv2
import numpy as np


class Pair(NamedTuple):
    """A corruption of another library, and the kind and level of ours that does the like.

    Where ``theirs`` is several of albumentations' in a row, joined by "+", ``options`` has those of
    each. ``does_less`` says that theirs leaves out most of what ours does.
    """

    library: str
    theirs: str
    ours: str
    level: float
    options: dict[str, Any]
    theirs_is: str
    does_less: bool = False


PAIRS = (
    Pair("imagecorruptions", "gaussian_noise", "noise", 46, {}, "float64 draws"),
    Pair("imagecorruptions", "shot_noise", "poisson", 60, {}, "exact Poisson draws, no read noise"),
    Pair("imagecorruptions", "impulse_noise", "salt_pepper", 45, {}, "each channel on its own"),
    Pair("imagecorruptions", "gaussian_blur", "blur", 83, {}, "float64, cut at 4 σ"),
    Pair("imagecorruptions", "defocus_blur", "blur", 60, {}, "a disc, not a Gaussian"),
    Pair("imagecorruptions", "motion_blur", "motion", 40, {}, "Gaussian weights along the smear"),
    Pair("imagecorruptions", "brightness", "over", 30, {}, "adds to V of HSV, no optics"),
    Pair("imagecorruptions", "fog", "fog", 60, {}, "a fractal mixed in, no depth, no law"),
    Pair("imagecorruptions", "snow", "snow", 60, {}, "a smeared layer of noise, no haze"),
    Pair("imagecorruptions", "spatter", "drops", 60, {}, "wet texture, no refraction"),
    Pair("imagecorruptions", "jpeg_compression", "jpeg", 63, {}, "the same codec by Pillow"),
    Pair("albumentations", "GaussNoise", "noise", 46, {"std_range": (0.18, 0.18)},
         "float32 draws"),
    Pair("albumentations", "ShotNoise", "poisson", 60, {}, "exact Poisson draws in linear light"),
    Pair("albumentations", "SaltAndPepper", "salt_pepper", 45, {"amount": (0.09, 0.09)},
         "the same"),
    Pair("albumentations", "GaussianBlur", "blur", 60,
         {"blur_limit": (13, 13), "sigma_limit": (2.3, 2.3)}, "the same, full kernel"),
    Pair("albumentations", "MotionBlur", "motion", 60, {"blur_limit": (25, 25)},
         "a drawn line as kernel"),
    Pair("albumentations", "RandomBrightnessContrast", "tunnel", 30,
         {"brightness_limit": (0.3, 0.3)}, "the same: a table of bytes, by the same library"),
    Pair("albumentations", "GaussianBlur+RandomBrightnessContrast", "over", 30,
         {"GaussianBlur": {"blur_limit": (3, 3), "sigma_limit": (0.8, 0.8)},
          "RandomBrightnessContrast": {"brightness_limit": (0.3, 0.3)}},
         "the like in two steps, rounded twice"),
    Pair("albumentations", "RandomBrightnessContrast", "over", 30,
         {"brightness_limit": (0.3, 0.3)}, "a table of bytes: no neighbours, no optics", True),
    Pair("albumentations", "RandomFog", "fog", 60, {}, "discs of grey, no depth, no law"),
    Pair("albumentations", "RandomRain", "rain", 60, {}, "equal streaks, darker, no haze"),
    Pair("albumentations", "RandomSnow", "snow", 60, {}, "whitens what is bright, no flakes"),
    Pair("albumentations", "ImageCompression", "jpeg", 63, {"quality_range": (15, 15)},
         "the same codec by OpenCV"),
    Pair("kornia", "RandomGaussianNoise", "noise", 46, {"std": 0.18}, "float32, not clipped"),
    Pair("kornia", "RandomSaltAndPepperNoise", "salt_pepper", 45, {"amount": 0.09},
         "float32"),
    Pair("kornia", "RandomGaussianBlur", "blur", 60,
         {"kernel_size": (13, 13), "sigma": (2.3, 2.3)}, "float32, full kernel"),
    Pair("kornia", "RandomMotionBlur", "motion", 60,
         {"kernel_size": 25, "angle": 45.0, "direction": 0.0}, "float32, a drawn line as kernel"),
    Pair("kornia", "RandomBrightness", "tunnel", 30, {"brightness": (1.3, 1.3)},
         "float32, adds instead of multiplying"),
    Pair("kornia", "RandomBrightness", "over", 30, {"brightness": (1.3, 1.3)},
         "float32, adds, no optics"),
    Pair("kornia", "RandomRain", "rain", 60,
         {"drop_height": (10, 15), "drop_width": (-3, 3), "number_of_drops": (700, 720)},
         "equal streaks, no haze"),
    Pair("kornia", "RandomSnow", "snow", 60, {}, "whitens what is bright, no flakes"),
    Pair("kornia", "RandomJPEG", "jpeg", 63, {"jpeg_quality": (15.0, 15.0)},
         "differentiable, without a codec"),
)  # fmt: skip
"""What is like enough to be compared; imagecorruptions at severity 3."""


def _call(pair: Pair, image: Any) -> Callable[[], Any]:
    library: Any = import_module(pair.library)
    if pair.library == "imagecorruptions":
        corruptions: Any = import_module("imagecorruptions.corruptions")
        corruptions.gaussian = _gaussian
        return partial(library.corrupt, image, corruption_name=pair.theirs, severity=3)
    if pair.library == "albumentations":
        names = pair.theirs.split("+")
        options = pair.options if len(names) > 1 else {pair.theirs: pair.options}
        steps = [getattr(library, name)(p=1.0, **options[name]) for name in names]
        return partial(library.Compose(steps) if len(steps) > 1 else steps[0], image=image)
    torch: Any = import_module("torch")
    torch.set_num_threads(1)
    torch.set_grad_enabled(False)
    transform = getattr(import_module("kornia.augmentation"), pair.theirs)(p=1.0, **pair.options)
    return partial(transform, torch.from_numpy(image).permute(2, 0, 1)[None] / 255.0)


def _gaussian(image: Any, multichannel: bool = False, **options: Any) -> Any:
    """Blur as imagecorruptions asks for it: newer scikit-image knows no ``multichannel``."""
    axis = -1 if multichannel else None
    return import_module("skimage.filters").gaussian(image, channel_axis=axis, **options)


def main(path: str, repeats: int) -> None:
    """Time every corruption on the image in ``path`` (.npz)."""
    warnings.simplefilter("ignore")
    cv2.setNumThreads(1)
    image = np.load(path)["image"]
    for pair in PAIRS:
        record: dict[str, Any] = {}
        try:
            call = _call(pair, image)
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
