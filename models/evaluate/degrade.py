"""What a degradation costs, and how far it is from its exact result.

One thread; 1600 × 900 × 3 images with power at every scale, scans of 250 clusters. Run times are
CPU times of the thread, medians. Errors are root mean squares against float64 arithmetic; for
noise, the Kolmogorov distance of its distribution from the rounded normal one.

JPEG is bounded by its codec, encoding and decoding by libjpeg-turbo; to leave entropy coding out
and transform the blocks by matrix products is slower, and not equal to the pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from statistics import NormalDist, median
from time import thread_time_ns
from typing import Any

import cv2
import numpy as np

from drivers.scan import RadarScan
from models.degrade import camera, imager
from models.degrade.draw import DrawKey
from models.degrade.kinds import KINDS, module_of
from models.evaluate.blocks import quantisation_tables, without_codec
from models.evaluate.exact import Exact, Image, exact
from models.evaluate.report import Goal, Point
from models.sensor import ARS408

_HEIGHT, _WIDTH = 900, 1600
_KEY = DrawKey(1, "bench", 7)
_BORDER = 12
_NOISE_LEVEL = 20.0
_METHODS: tuple[camera.Method, ...] = ("fast", "exact")


def run(quick: bool) -> Iterator[Point | Goal]:
    """Measure every kind at one level, or the ones with a choice of method at several."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield from _camera(quick)
        yield from _radar(quick)
    finally:
        cv2.setNumThreads(threads)


def textured_image(height: int = _HEIGHT, width: int = _WIDTH) -> Image:
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


def cpu_time_us(call: Callable[[], object], quick: bool) -> float:
    """Return the median CPU time of a call, µs, after one call to warm up."""
    call()
    times = []
    for _ in range(3 if quick else 21):
        start = thread_time_ns()
        call()
        times.append(thread_time_ns() - start)
    return median(times) / 1e3


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
    yield from _without_codec(quick, image)
    yield Goal("over-exposure, ms", slowest["over"] / 1e3, 1.5, False)
    yield Goal("under-exposure, ms", slowest["under"] / 1e3, 1.5, False)
    yield Goal("noise, ms", slowest["noise"] / 1e3, 3.0, False)
    yield Goal("blur at the slowest level, ms", slowest["blur"] / 1e3, 4.0, False)
    yield Goal("blur, greatest error inside, counts", worst_blur, 4.0, False)
    slow = max(slowest, key=lambda kind: slowest[kind])
    yield Goal(f"slowest camera kind ({slow}), ms", slowest[slow] / 1e3, 5.0, False)


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
    gray = np.full((_HEIGHT // 2, _WIDTH // 2, 3), 128, np.uint8)
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
    gray = np.full((_HEIGHT // 2, _WIDTH // 2, 3), 128, np.uint8)
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
    """Measure the kinds that have one method; those defined by their steps have no error."""
    small = textured_image(300, 480)
    for kind, level in product(KINDS["camera"], (60.0,) if quick else (10.0, 60.0, 100.0)):
        if kind in camera.KINDS:
            continue
        module = module_of("camera", kind)
        drawn = module.draw(kind, level, _KEY)
        time_us = cpu_time_us(partial(module.apply, drawn, image), quick)
        error = 0.0
        if kind == "motion":
            error = _rms(module.apply(drawn, small), exact(drawn, small))
        if kind == "fog":
            even = replace(drawn, haze=replace(drawn.haze, patchiness=0.0))
            error = _rms(module.apply(even, small), exact(even, small))
        unit = "counts, of one method" if error else "counts, of kinds defined by their steps"
        unit = "counts, jpeg" if kind == "jpeg" else unit
        yield Point(kind, f"level={level:g}", time_us, error, unit)
        slowest[kind] = max(slowest.get(kind, 0.0), time_us)


def _without_codec(quick: bool, image: Image) -> Iterator[Point]:
    """Measure JPEG's loss without entropy coding, and how far it is from the codec's."""
    drawn: Any = imager.draw("jpeg", 60.0, _KEY)
    lossy = imager.apply(drawn, image)
    _, stream = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, drawn.quality])
    tables = quantisation_tables(np.asarray(stream, np.uint8))
    call = partial(without_codec, image, *tables)
    error = _rms(call(), lossy.astype(np.float64))
    time_us = cpu_time_us(call, quick)
    yield Point("jpeg, without a codec", "level=60", time_us, error, "counts, jpeg")


def _radar(quick: bool) -> Iterator[Point | Goal]:
    """Measure every kind on scans to which something happens."""
    scan = full_scan()
    times: dict[str, float] = {}
    for kind in KINDS["radar"]:
        module = module_of("radar", kind)
        drawn = [module.draw(kind, 60.0, DrawKey(1, "bench", sequence)) for sequence in range(40)]
        hits = [one for one in drawn if module.apply(one, scan) is not scan][:10]
        times[kind] = median(cpu_time_us(partial(module.apply, one, scan), quick) for one in hits)
        yield Point(f"radar {kind}", "level=60", times[kind], 0.0, "m")
    yield Goal("250 clusters, snr, µs", times["snr"], 100.0, False)
    slow = max(times, key=lambda kind: times[kind])
    yield Goal(f"250 clusters, slowest radar kind ({slow}), µs", times[slow], 100.0, False)
