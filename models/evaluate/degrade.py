"""What a degradation costs, and how far it is from its exact result.

One thread; 1600 × 900 × 3 images with power at every scale, scans of 250 clusters. Run times are
CPU times of the thread, medians. Errors are root mean squares against float64 arithmetic; for
noise, the Kolmogorov distance of its distribution from the rounded normal one. JPEG's is that of
its integer transform: where it falls to the other side of a quantisation step, a block differs.

JPEG is bounded by its codec: the kind is libjpeg-turbo's encoder and decoder, one after the other,
with nothing beside them to save. Its transforms and colours take what is left at 100 %, where there
is hardly anything to code; the rest is entropy coding, the more the better the quality, so that the
lowest levels are the slowest. Decoding takes a tenth less where chroma is not smoothed, which is
another picture. To leave entropy coding out and transform the blocks by matrix products is slower,
and not equal to the pixel.

Radar kinds are applied to a scan in what is called their time; to draw their parameters, once a
scan, is beside it in the table.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import product
from statistics import NormalDist, median
from typing import Any

import cv2
import numpy as np

from models.degrade import camera, imager
from models.degrade.draw import DrawKey
from models.degrade.kinds import KINDS, module_of
from models.evaluate.blocks import quantisation_tables, without_codec
from models.evaluate.exact import Exact, Image, exact
from models.evaluate.report import Goal, Point, Result, Table
from models.evaluate.samples import HEIGHT, WIDTH, full_scan, textured_image
from models.evaluate.timing import cpu_time_us, one_thread

_KEY = DrawKey(1, "bench", 7)
_BORDER = 12
_NOISE_LEVEL = 20.0
_METHODS: tuple[camera.Method, ...] = ("fast", "exact")


def run(quick: bool) -> Iterator[Result]:
    """Measure every kind at one level, or the ones with a choice of method at several."""
    with one_thread():
        yield from _camera(quick)
        yield from _jpeg(quick)
        yield from _radar(quick)


def _rms(result: Image, reference: Exact) -> float:
    error = (result - np.clip(reference, 0, 255))[_BORDER:-_BORDER, _BORDER:-_BORDER]
    return float(np.sqrt(np.mean(error**2)))


def _camera(quick: bool) -> Iterator[Point | Goal]:
    image = textured_image()
    slowest: dict[str, float] = {}
    worst_blur = 0.0
    methods: list[Point] = []
    for level in (60.0,) if quick else (10.0, 30.0, 50.0, 60.0, 80.0, 100.0):
        for kind, method, drawn, reference in _methods(level, image):
            time_us = cpu_time_us(partial(camera.apply, drawn, image), quick)
            result = camera.apply(drawn, image)
            error = _rms(result, reference)
            methods.append(_point(kind, method, level, time_us, error, "counts"))
            if method == "fast":
                slowest[kind] = max(slowest.get(kind, 0.0), time_us)
            if (kind, method) == ("blur", "fast"):
                inside = np.s_[_BORDER:-_BORDER, _BORDER:-_BORDER]
                worst_blur = max(worst_blur, float(np.abs(result - reference)[inside].max()))
    methods.extend(_noise(quick, image, slowest))
    yield from methods
    yield from _repetition()
    yield Goal("defaults that another method beats", _beaten(methods), 0, False)
    yield from _others(quick, image, slowest)
    yield Goal("over-exposure, ms", slowest["over"] / 1e3, 1.5, False)
    yield Goal("under-exposure, ms", slowest["under"] / 1e3, 1.5, False)
    yield Goal("noise, ms", slowest["noise"] / 1e3, 3.0, False)
    yield Goal("blur at the slowest level, ms", slowest["blur"] / 1e3, 4.0, False)
    yield Goal("blur, greatest error inside, counts", worst_blur, 4.0, False)
    slow = max(slowest, key=lambda kind: slowest[kind])
    yield Goal(f"slowest camera kind but jpeg ({slow}), ms", slowest[slow] / 1e3, 5.0, False)


def _point(kind: str, method: str, level: float, time_us: float, error: float, unit: str) -> Point:
    """Return a point of a plot that the kind has for itself."""
    name = "fast (default)" if method == "fast" else method
    return Point(f"{kind}, {name}", f"level={level:g}", time_us, error, f"{unit}, {kind}")


def _beaten(points: list[Point]) -> int:
    """Count the defaults to which another method of the kind is preferable at the same level.

    It is where it is no less exact and takes under nine tenths of the time; the times of one and
    the same method, measured twice, differ by less.
    """
    return sum(
        other.error <= point.error and other.run_time_us < 0.9 * point.run_time_us
        for point in points
        for other in points
        if "(default)" in point.variant and (other.unit, other.knob) == (point.unit, point.knob)
    )


def _methods(level: float, image: Image) -> Iterator[tuple[str, str, Any, Exact]]:
    """Yield kind, method, drawn parameters and the exact result of the kinds with a choice."""
    for kind in ("blur", "over", "under"):
        reference: Exact | None = None
        for method in _METHODS:
            drawn = camera.draw(kind, level, _KEY, method=method)
            reference = exact(drawn, image) if reference is None else reference
            yield kind, method, drawn, reference


def _noise(quick: bool, image: Image, slowest: dict[str, float]) -> Iterator[Point]:
    gray = np.full((HEIGHT // 2, WIDTH // 2, 3), 128, np.uint8)
    level, unit = _NOISE_LEVEL, "Kolmogorov distance"
    for method in _METHODS:
        drawn = camera.draw("noise", _NOISE_LEVEL, _KEY, method=method)
        time_us = cpu_time_us(partial(camera.apply, drawn, image), quick)
        distance = _kolmogorov(camera.apply(drawn, gray))
        yield _point("noise", method, level, time_us, distance, unit)
        if method == "fast":
            slowest["noise"] = time_us
    time_us = cpu_time_us(partial(_add_randn, image), quick)
    yield _point("noise", "cv2.randn", level, time_us, _kolmogorov(_add_randn(gray)), unit)


def _add_randn(image: Image) -> Image:
    noise = np.empty(image.shape, np.int16)
    cv2.randn(noise, np.zeros(3), np.full(3, _NOISE_LEVEL))
    return np.asarray(cv2.add(image, noise, dtype=cv2.CV_8U), np.uint8)


def _kolmogorov(noisy: Image) -> float:
    values, counts = np.unique(noisy.astype(int) - 128, return_counts=True)
    normal = NormalDist(0, _NOISE_LEVEL)
    expected = np.array([normal.cdf(value + 0.5) for value in values.tolist()])
    return float(np.abs(np.cumsum(counts) / noisy.size - expected).max())


def _repetition() -> Iterator[Goal]:
    """Yield the greatest correlation of noise with itself moved, and with the next frame's."""
    gray = np.full((HEIGHT // 2, WIDTH // 2, 3), 128, np.uint8)
    spectra = []
    for sequence in (0, 1):
        drawn = camera.draw("noise", _NOISE_LEVEL, DrawKey(1, "bench", sequence))
        noise = camera.apply(drawn, gray).ravel() - 128.0
        spectra.append(np.fft.rfft(noise / noise.std(), 2 * noise.size))
    within = np.fft.irfft(np.abs(spectra[0]) ** 2)[1 : gray.size] / gray.size
    between = np.fft.irfft(spectra[0] * spectra[1].conj()) / gray.size
    for where, correlation in (("within a frame", within), ("between frames", between)):
        greatest = float(np.abs(correlation).max())
        yield Goal(f"noise, greatest correlation {where}", greatest, 0.01, False)


def _others(quick: bool, image: Image, slowest: dict[str, float]) -> Iterator[Point]:
    """Measure the kinds that have one method."""
    small = textured_image(300, 480)
    for kind, level in product(KINDS["camera"], (60.0,) if quick else (10.0, 60.0, 100.0)):
        if kind in camera.KINDS or kind == "jpeg":
            continue
        module = module_of("camera", kind)
        drawn = module.draw(kind, level, _KEY)
        time_us = cpu_time_us(partial(module.apply, drawn, image), quick)
        error = _rms(module.apply(drawn, small), exact(drawn, small))
        yield Point(kind, f"level={level:g}", time_us, error, "counts, of one method")
        slowest[kind] = max(slowest.get(kind, 0.0), time_us)


def _jpeg(quick: bool) -> Iterator[Result]:
    """Measure JPEG, of what its time is made up, and its loss without entropy coding."""
    image = textured_image()
    small, rows, unit = textured_image(300, 480), [], "counts, jpeg"
    for level in (60.0,) if quick else (1.0, 10.0, 60.0, 100.0):
        drawn: Any = imager.draw("jpeg", level, _KEY)
        encode = partial(cv2.imencode, ".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, drawn.quality])
        stream = np.asarray(encode()[1], np.uint8)
        decode = partial(imager.decoded, stream)
        times = [cpu_time_us(call, quick) for call in (encode, decode)]
        whole = cpu_time_us(partial(imager.apply, drawn, image), quick)
        reference, knob = exact(drawn, small), f"level={level:g}"
        yield Point("jpeg", knob, whole, _rms(imager.apply(drawn, small), reference), unit)
        overhead = 100 * (whole / sum(times) - 1)
        rows.append(
            (f"{level:g} %", drawn.quality, *(us / 1e3 for us in (*times, whole)), overhead)
        )
        if level == 60:
            tables = quantisation_tables(stream)
            time_us = cpu_time_us(partial(without_codec, image, *tables), quick)
            error = _rms(without_codec(small, *tables), reference)
            yield Point("jpeg, without a codec", knob, time_us, error, unit)
    columns = ("jpeg", "quality", "encoding, ms", "decoding, ms", "as the kind, ms", "overhead, %")
    yield Table("JPEG: the codec's own time", columns, tuple(rows))
    yield Goal("jpeg at its slowest level, ms", max(row[-2] for row in rows), 5.0, False)


def _radar(quick: bool) -> Iterator[Result]:
    """Measure every kind on scans to which something happens."""
    scan = full_scan()
    rows: list[tuple[str, float, float]] = []
    for kind in KINDS["radar"]:
        module = module_of("radar", kind)
        drawn = [module.draw(kind, 60.0, DrawKey(1, "bench", sequence)) for sequence in range(40)]
        hits = [one for one in drawn if module.apply(one, scan) is not scan][:10]
        applying = median(cpu_time_us(partial(module.apply, one, scan), quick) for one in hits)
        drawing = cpu_time_us(partial(module.draw, kind, 60.0, _KEY), quick)
        yield Point(f"radar {kind}", "level=60", applying, 0.0, "m")
        rows.append((kind, drawing, applying))
    yield Table("Radar: 250 clusters", ("kind", "drawing, µs", "applying, µs"), tuple(rows))
    times = {kind: applying for kind, _, applying in rows}
    yield Goal("250 clusters, snr, µs", times["snr"], 100.0, False)
    slow = max(times, key=lambda kind: times[kind])
    yield Goal(f"250 clusters, slowest radar kind ({slow}), µs", times[slow], 100.0, False)
