"""What comes out of the degradations at the edge of what can go in.

The formulas in float64, as used, against 50-digit decimal arithmetic. Every camera kind against
float64, its worst pixel on images of one row, one column, one pixel, all black and all white, and
one with texture. Every radar kind, its worst value as it leaves, float32 on the bus's grid, against
the same law in arithmetic of 64 bits of mantissa (where the machine has such numbers) put on the
grid: what is left is the last bit of float32. And every kind at levels from 0 to 100 % on images
and scans that no sensor should send, with warnings taken as errors.

What the camera kinds owe to their speed: motion is 32 copies of the image moved by whole pixels;
banks of fog are computed at a quarter of the image's size, which shows on an image of 45 rows;
JPEG's transform is in integers, and where it falls to the other side of a quantisation step it is
off by such a step. The rest is rounding.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from decimal import Decimal, localcontext
from functools import partial
from itertools import product
from time import perf_counter_ns
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from drivers.scan import RadarScan
from models.degrade import radar
from models.degrade.draw import DrawKey
from models.degrade.kinds import KINDS, module_of
from models.degrade.radar import echo_db, echo_over_threshold, std_growth
from models.degrade.sequence import RandomWalk
from models.evaluate.exact import exact
from models.evaluate.exact_radar import exact_rows
from models.evaluate.report import Goal, Point
from models.evaluate.samples import full_scan, textured_image
from models.sensor import ARS408

_LEVELS = (0.0, 1e-9, 1e-3, 60.0, 100.0)
_REFUSED = (-1.0, -1e-9, 100.1, 1000.0, 1e6, math.nan, math.inf, -math.inf)
_SEQUENCES = (0, 1, 2**31, 2**62)
_WALKS = 400
_ANY_UNIT = "m, m/s or dBm²"


def run(quick: bool) -> Iterator[Point | Goal]:
    """Tabulate the formulas' errors, then count what fails: nothing may."""
    yield from _formulas()
    yield from _pixels()
    yield from _clusters(3 if quick else 10)
    yield from _walks(100 if quick else _WALKS)
    yield from _every_kind(_SEQUENCES[:2] if quick else _SEQUENCES)


def _formulas() -> Iterator[Point]:
    for distance, rcs in product((0.0, 1e-3, 0.2, 1.0, 250.0, 1e6), (-1e3, -64.0, 63.5, 1e3)):
        time_us, value = _timed(partial(echo_db, np.array([distance]), np.array([rcs])))
        exact = Decimal(rcs) - 40 * Decimal(max(distance, ARS408.range_min_m)).log10()
        error = abs(float(Decimal(float(value[0])) - exact))
        yield Point("echo, RCS - 40 log r", f"r={distance:g} m, {rcs:g} dBm²", time_us, error, "dB")
    for drop in (-300.0, 0.0, 1e-9, 1e-3, 10.0, 20.0, 300.0):
        time_us, growth = _timed(partial(std_growth, drop))
        with localcontext(prec=50):
            exact = (Decimal(10) ** (Decimal(max(drop, 0.0)) / 10) - 1).sqrt()
            error = float(abs(Decimal(float(growth)) - exact) / exact) if exact else float(growth)
        yield Point("Cramér–Rao growth", f"drop={drop:g} dB", time_us, error, "relative")

    for over in (-300.0, -10.0, -1e-9, 0.0, 1e-9, 10.0, 300.0):
        time_us, remaining = _timed(partial(echo_over_threshold, np.array([over]), 0.0))
        with localcontext(prec=50):
            exactly = Decimal(10) ** (Decimal(over) / 10)
            error = float(abs(Decimal(float(remaining[0])) - exactly) / exactly)
        yield Point("missed, echo over threshold", f"{over:g} dB", time_us, error, "relative")


def _pixels() -> Iterator[Point]:
    """Yield the worst pixel of each camera kind, nothing of it cut away."""
    for kind, level in product(KINDS["camera"], _LEVELS[1:]):
        module = module_of("camera", kind)
        drawn = module.draw(kind, level, DrawKey(1, "camera", 0))
        worst = time_us = 0.0
        for image in _images():
            time_us, result = _timed(partial(module.apply, drawn, image))
            error = np.abs(result - np.clip(exact(drawn, image), 0, 255)).max()
            worst = max(worst, float(error))
        yield Point(f"{kind}, worst pixel", f"level={level:g}", time_us, worst, "counts")


def _clusters(sequences: int) -> Iterator[Point]:
    """Yield the worst value of each radar kind, as float32 on the bus's grid."""
    scans = _short_scans()
    asked: list[tuple[str, float, dict[str, float]]] = [
        *((kind, level, {}) for kind, level in product(KINDS["radar"], _LEVELS[1:])),
        *((kind, 100.0, {"snr_drop_db": 300.0}) for kind in radar.KINDS),
    ]
    for kind, level, options in asked:
        module = module_of("radar", kind)
        worst = time_us = 0.0
        for scan, sequence in product(scans, range(sequences)):
            drawn = module.draw(kind, level, DrawKey(1, "radar", sequence), **options)
            time_us, result = _timed(partial(module.apply, drawn, scan))
            if result is not scan:
                worst = max(worst, _deviation(result, exact_rows(drawn, scan, ARS408)))
        knob = f"level={level:g}{', 300 dB' if options else ''}"
        yield Point(f"{kind}, worst value", knob, time_us, worst, _ANY_UNIT)


def _deviation(scan: RadarScan, rows: NDArray[np.longdouble]) -> float:
    """Return how far any value is from the exact one on the grid; infinite if a cluster is."""
    if len(scan) != rows.shape[1]:
        return math.inf
    got, expected = [], []
    for field, exactly in zip(ARS408.grid, rows, strict=True):
        step, offset = np.longdouble(field.step), np.longdouble(field.offset)
        raw = np.clip(np.rint((exactly - offset) / step), 0, field.count - 1)
        expected.append(raw * step + offset)
        got.append(getattr(scan, field.name).astype(np.longdouble))
    ranked = [
        columns[:, np.lexsort(np.rint(columns / 0.05))]
        for columns in map(np.array, (got, expected))
    ]
    return float(np.abs(ranked[0] - ranked[1]).max(initial=0.0))


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    start = perf_counter_ns()
    value = call()
    return (perf_counter_ns() - start) / 1e3, value


def _ends(walks: list[RandomWalk], t_s: float) -> list[float]:
    return [walk.level_at(t_s) for walk in walks]


def _walks(count: int) -> Iterator[Point]:
    """Yield how far the spread of a walk's increments is from its law at each time step."""
    for step in (1e-9, 1e-6, 1e-3, 1.0, 3600.0, 86400.0):
        rate = 1e-3 / math.sqrt(step)  # small against the bounds, so that none is reached
        walks = [RandomWalk(seed, 50.0, rate) for seed in range(count)]
        time_us, ends = _timed(partial(_ends, walks, step))
        spread = float(np.std(np.array(ends) - 50.0)) / 1e-3
        knob = f"step={step:g} s, {count} walks"
        yield Point(
            "random walk, spread", knob, time_us / count, abs(spread - 1), "relative, of so many"
        )


def _every_kind(sequences: tuple[int, ...]) -> Iterator[Goal]:
    failed = off_grid = accepted = calls = changed = uncounted = 0
    for sensor, kinds in KINDS.items():
        messages = _images() if sensor == "camera" else _scans()
        for kind in kinds:
            module = module_of(sensor, kind)
            accepted += sum(_accepts(module, kind, level) for level in _REFUSED)
            for message, level, sequence in product(messages, _LEVELS, sequences):
                calls += 1
                key = DrawKey(1, sensor, sequence)
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    try:
                        result = module.apply(module.draw(kind, level, key), message)
                    except (ArithmeticError, ValueError, IndexError, TypeError, Warning):
                        failed += 1
                        continue
                changed += level == 0 and result is not message
                if isinstance(message, RadarScan) and result is not message:
                    off_grid += _off_grid(result)
                    uncounted += result.frames_lost - message.frames_lost != _no_numbers(message)
    yield Goal(f"of {calls} calls, warned or failed", failed, 0, False)
    yield Goal("values off the CAN grid", off_grid, 0, False)
    yield Goal("scans whose clusters of NaN or infinity are not counted", uncounted, 0, False)
    yield Goal("changed at level 0", changed, 0, False)
    yield Goal("levels out of range that were let in", accepted, 0, False)
    wide = np.zeros((45, 80, 3), np.uint16)
    let_in = sum(_takes(kind, wide) for kind in KINDS["camera"])
    yield Goal("kinds that take images of 16 bits", let_in, 0, False)


def _accepts(module: Any, kind: str, level: float) -> bool:
    try:
        module.draw(kind, level, DrawKey(1, "sensor", 0))
    except InputError:
        return False
    return True


def _takes(kind: str, image: Any) -> bool:
    module = module_of("camera", kind)
    try:
        module.apply(module.draw(kind, 50.0, DrawKey(1, "camera", 0)), image)
    except InputError:
        return False
    return True


def _no_numbers(scan: RadarScan) -> int:
    """Return how many clusters have a value that is no number."""
    values = [getattr(scan, field.name) for field in ARS408.grid]
    return int(np.count_nonzero(~np.isfinite(values).all(axis=0)))


def _off_grid(scan: RadarScan) -> int:
    """Return how many values the bus cannot carry; NaN is one of them."""
    wrong = 0
    for field in ARS408.grid:
        values = getattr(scan, field.name)
        on_grid = ARS408.to_grid(field.name, np.nan_to_num(values)).astype(np.float32)
        wrong += int(np.count_nonzero(values != on_grid))
    return wrong


def _images() -> list[np.ndarray[Any, np.dtype[np.uint8]]]:
    shapes = [(1, 1), (1, 640), (480, 1), (2, 2), (45, 80)]
    return [
        *(np.full((*shape, 3), value, np.uint8) for shape in shapes for value in (0, 255)),
        textured_image(90, 161),
    ]


def _scans() -> list[RadarScan]:
    full = full_scan()
    n = len(full)

    def some(count: int, **fields: float) -> RadarScan:
        arrays: dict[str, Any] = {name: array[:count] for name, array in full.arrays().items()}
        arrays |= {name: np.full(count, value, np.float32) for name, value in fields.items()}
        return replace(full, near=count, far=0, **arrays)

    return [
        full,
        some(0),
        some(1),
        _thousand_equal(full),
        some(1, x=0.0, y=0.0),
        some(n, x=30.0, y=1.1),
        some(n, x=1e6, y=-1e6, vx=1e6, vy=-1e6),
        some(n, rcs=1e3),
        some(n, rcs=-1e3),
        some(n, x=-40.0, y=90.1),
        some(n, x=3e38, y=3e38, vx=-3e38, rcs=3e38),
        some(n, x=math.nan),
        some(n, rcs=math.inf),
        some(n, vx=-math.inf, vy=math.inf),
    ]


def _short_scans() -> list[RadarScan]:
    """Return the finite ones, of at most 80 clusters: with all their images none is cut off."""
    short = []
    for scan in _scans():
        arrays: dict[str, Any] = {name: array[:80] for name, array in scan.arrays().items()}
        if all(np.isfinite(array).all() for array in arrays.values()):
            n = len(arrays["x"])
            short.append(replace(scan, near=n, far=0, **arrays))
    return short


def _thousand_equal(scan: RadarScan) -> RadarScan:
    """Return more clusters than a cycle carries, all the same one."""
    arrays: dict[str, Any] = {name: np.repeat(a[:1], 1000) for name, a in scan.arrays().items()}
    return replace(scan, near=1000, far=0, **arrays)
