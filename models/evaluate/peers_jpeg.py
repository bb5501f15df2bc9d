"""Times JPEG codecs; run by another interpreter, imports nothing of murk.

Prints a JSON object a line, a codec that is installed at a quality: CPU time in ms of encoding and
of decoding alone, and how far its picture is at most from the one that is given.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from importlib import import_module
from io import BytesIO
from statistics import median
from time import thread_time
from typing import Any, NamedTuple

import numpy as np


class Codec(NamedTuple):
    """A codec's two calls.

    ``take`` turns RGB into what ``encode`` is given, with the quality; it is not timed. ``decode``
    is given what that returned, and returns a picture in RGB, or in BGR where ``bgr`` says so.
    """

    take: Callable[[Any], Any]
    encode: Callable[[Any, int], Any]
    decode: Callable[[Any], Any]
    bgr: bool = False


def _reversed(image: Any) -> Any:
    return np.ascontiguousarray(image[..., ::-1])


def _opencv() -> Codec:
    cv2: Any = import_module("cv2")
    cv2.setNumThreads(1)

    def encode(image: Any, quality: int) -> Any:
        return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]

    return Codec(_reversed, encode, lambda stream: cv2.imdecode(stream, cv2.IMREAD_COLOR), bgr=True)


def _pillow() -> Codec:
    pillow: Any = import_module("PIL.Image")

    def encode(picture: Any, quality: int) -> Any:
        file = BytesIO()
        picture.save(file, "JPEG", quality=quality)
        return file

    def decode(file: Any) -> Any:
        picture = pillow.open(file)
        picture.load()
        return picture

    return Codec(pillow.fromarray, encode, decode)


def _simplejpeg() -> Codec:
    simplejpeg: Any = import_module("simplejpeg")

    def encode(image: Any, quality: int) -> Any:
        return simplejpeg.encode_jpeg(image, quality, colorsubsampling="420", fastdct=False)

    return Codec(np.ascontiguousarray, encode, simplejpeg.decode_jpeg)


def _imagecodecs() -> Codec:
    imagecodecs: Any = import_module("imagecodecs")

    def encode(image: Any, quality: int) -> Any:
        return imagecodecs.jpeg8_encode(image, quality, subsampling="420")

    return Codec(np.ascontiguousarray, encode, imagecodecs.jpeg8_decode)


def _kornia() -> Codec:
    io: Any = import_module("kornia_rs").io
    return Codec(np.ascontiguousarray, io.encode_image_jpeg, io.decode_image_jpeg)


CODECS = {
    "OpenCV": _opencv,
    "Pillow, as imagecorruptions calls it": _pillow,
    "simplejpeg": _simplejpeg,
    "imagecodecs": _imagecodecs,
    "kornia-rs, in Rust": _kornia,
}


def _timed(call: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Return the median CPU time, ms, after one call that does not count, and the result."""
    result, times = call(), []
    for _ in range(repeats):
        start = thread_time()
        call()
        times.append(thread_time() - start)
    return median(times) * 1e3, result


def _measure(codec: Codec, image: Any, quality: int, ours: Any, repeats: int) -> dict[str, Any]:
    taken = codec.take(image)
    encoding, stream = _timed(lambda: codec.encode(taken, quality), repeats)
    decoding, picture = _timed(lambda: codec.decode(stream), repeats)
    picture = np.asarray(picture)
    picture = _reversed(picture) if codec.bgr else picture
    difference = int(np.abs(picture.astype(int) - ours).max())
    return {"encoding_ms": encoding, "decoding_ms": decoding, "difference": difference}


def main(path: str, repeats: int) -> None:
    """Time every codec on the image in ``path`` (.npz), which has our picture by quality, too."""
    with np.load(path) as file:
        image, *pictures = (_reversed(file[name]) for name in file.files)
        qualities = [int(name) for name in file.files[1:]]
    for name, make in CODECS.items():
        try:
            codec = make()
        except ModuleNotFoundError:
            continue
        for quality, ours in zip(qualities, pictures, strict=True):
            record = _measure(codec, image, quality, ours, repeats)
            sys.stdout.write(json.dumps({"codec": name, "quality": quality, **record}) + "\n")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
