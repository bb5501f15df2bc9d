"""What comes out of the degradations at the edge of what can go in.

The formulas in float64, as used, against 50-digit decimal arithmetic; and every kind at levels
from 1e-9 to 100 % on images and scans that no sensor should send, with warnings taken as errors.
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

from dbc.errors import InputError
from drivers.scan import RadarScan
from models.degrade.draw import DrawKey
from models.degrade.kinds import KINDS, module_of
from models.degrade.radar import echo_db, std_growth
from models.degrade.sequence import RandomWalk
from models.evaluate.degrade import full_scan, textured_image
from models.evaluate.report import Goal, Point
from models.sensor import ARS408

_LEVELS = (1e-9, 1e-3, 50.0, 100.0)
_REFUSED = (-1.0, -1e-9, 100.1, 1000.0, 1e6, math.nan, math.inf, -math.inf)
_SEQUENCES = (0, 1, 2**31, 2**62)
_WALKS = 400


def run(quick: bool) -> Iterator[Point | Goal]:
    """Tabulate the formulas' errors, then count what fails: nothing may."""
    yield from _formulas()
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
        yield Point("random walk, spread", knob, time_us / count, abs(spread - 1), "relative")


def _every_kind(sequences: tuple[int, ...]) -> Iterator[Goal]:
    failed = off_grid = accepted = calls = 0
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
                if sensor == "radar" and result is not message:
                    off_grid += _off_grid(result)
    yield Goal(f"of {calls} calls, warned or failed", failed, 0, False)
    yield Goal("values off the CAN grid", off_grid, 0, False)
    yield Goal("levels out of range that were let in", accepted, 0, False)


def _accepts(module: Any, kind: str, level: float) -> bool:
    try:
        module.draw(kind, level, DrawKey(1, "sensor", 0))
    except InputError:
        return False
    return True


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
        some(1, x=0.0, y=0.0),
        some(n, x=30.0, y=1.1),
        some(n, x=1e6, y=-1e6, vx=1e6, vy=-1e6),
        some(n, rcs=1e3),
        some(n, rcs=-1e3),
        some(n, x=-40.0, y=90.0),
        some(n, x=3e38, y=3e38, vx=-3e38, rcs=3e38),
        some(n, x=math.nan),
        some(n, rcs=math.inf),
        some(n, vx=-math.inf, vy=math.inf),
    ]
