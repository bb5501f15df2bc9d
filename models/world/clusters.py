"""From measured echoes to an ARS 408 cluster list: velocities, dynamic property, quality fields.

The statistics (which flag how often, under which condition) follow real recordings of the sensor.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.sensor import ARS408
from models.world.beam import Beam
from models.world.objects import Floats
from models.world.points import Echoes, Motion
from models.world.sight import Antenna

_MOVING, _STATIONARY, _ONCOMING, _CANDIDATE, _UNKNOWN = 0, 1, 2, 3, 4
_CROSSING_SLOWLY, _CROSSING, _STOPPED = 5, 6, 7

_STANDS = np.isin(np.arange(8), (_STATIONARY, _CANDIDATE, _CROSSING_SLOWLY, _STOPPED))
_MOVES = np.isin(np.arange(len(Motion)), (Motion.MOVING, Motion.CROSSING, Motion.MIRRORED))
_PDH0 = np.array([1, 1, 1, 6, 3, 1, 6, 6, 1, 3, 3, 3, 3, 1, 1, 1, 1, 1], np.uint8)
"""False-alarm class by InvalidState."""

QUALITY = ("x_rms", "y_rms", "vx_rms", "vy_rms", "pdh0", "ambig_state", "invalid_state")
"""Fields that come with the quality frames."""

Columns = dict[str, NDArray[Any]]


def describe(
    echoes: Echoes,
    beam: Beam,
    antenna: Antenna,
    confirmed: NDArray[np.bool_],
    rng: np.random.Generator,
) -> Columns:
    """Return the fields of ``RadarScan`` for one list.

    Parameters
    ----------
    echoes:
        Sorted by range.
    beam:
        The scan that measured them.
    antenna:
        The sensor's own motion, which it takes out of what stands.
    confirmed:
        (n,) which echoes the other scan has too.
    rng:
        Draws the flags.
    """
    outside = np.abs(echoes.azimuth) > beam.half_width
    dyn = _dyn_prop(echoes, antenna, outside, rng)
    invalid, pdh0 = _validity(echoes, beam, confirmed, outside, rng)
    cos, sin = np.cos(echoes.azimuth), np.sin(echoes.azimuth)
    x, y = echoes.r * cos, echoes.r * sin
    standing = _STANDS[dyn]
    vy = np.where(standing, -antenna.left - antenna.yaw_rate * x, 0.0)
    vx = (echoes.speed - vy * sin) / np.maximum(cos, 0.1)
    known = ~outside
    rms = _rms(echoes, beam)
    columns: Columns = {
        name: ARS408.to_grid(name, value).astype(np.float32)
        for name, value in {
            "x": x,
            "y": y,
            "vx": vx * known,
            "vy": vy * known,
            "rcs": echoes.rcs,
        }.items()
    }
    columns |= {"dyn_prop": dyn, "pdh0": pdh0, "invalid_state": invalid}
    columns["ambig_state"] = _ambiguity(echoes, dyn, pdh0, rng)
    columns |= {name: (index * known).astype(np.uint8) for name, index in rms.items()}
    return columns


def _dice(echoes: Echoes, which: int, rng: np.random.Generator) -> Floats:
    """Return numbers uniform on [0, 1) that change little from scan to scan for one reflector.

    Different ``which`` give numbers that know nothing of each other.
    """
    own = echoes.chance * (97.0 + 101.0 * which) + 0.04 * rng.normal(size=len(echoes))
    return np.asarray(own % 1.0)


def _dyn_prop(
    echoes: Echoes, antenna: Antenna, outside: NDArray[np.bool_], rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Return DynProp; what stands is first a candidate, the longer the farther and fainter."""
    doubt = 0.0078 * np.minimum(echoes.r, 85) - 0.016 * (echoes.rcs - 4)
    doubt += 0.02 * np.clip(np.where(np.isfinite(echoes.rivalry), echoes.rivalry, 0), -4, 10)
    dyn = np.where(_dice(echoes, 1, rng) < doubt, _CANDIDATE, _STATIONARY)
    cos, sin = np.cos(echoes.azimuth), np.sin(echoes.azimuth)
    over_ground = echoes.speed + antenna.ahead * cos + antenna.left * sin
    moving = _MOVES[echoes.motion]
    dyn[moving] = np.where(over_ground[moving] < 0, _ONCOMING, _MOVING)
    crossing = (echoes.motion == Motion.CROSSING) & (echoes.r < 36)
    dyn[crossing] = np.where(np.abs(over_ground[crossing]) < 0.2, _CROSSING_SLOWLY, _CROSSING)
    dyn[echoes.motion == Motion.STOPPED] = _STOPPED
    dyn[outside] = _UNKNOWN
    return dyn.astype(np.uint8)


def _validity(
    echoes: Echoes,
    beam: Beam,
    confirmed: NDArray[np.bool_],
    outside: NDArray[np.bool_],
    rng: np.random.Generator,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return InvalidState and the false-alarm class Pdh0 that goes with it."""
    n = len(echoes)
    degrees = np.degrees(np.abs(echoes.azimuth))
    u, v, w = (_dice(echoes, which, rng) for which in (2, 3, 4))
    state = np.zeros(n, np.uint8)
    multiple = 0.01 + 0.002 * degrees + 0.25 * np.isfinite(echoes.rivalry)
    state[u < multiple] = 16
    if not beam.far:
        state[(state == 0) & (echoes.r > 95) & (degrees < 9)] = 15
        state[w < 0.75 * np.exp(-(((degrees - 50.3) / 1.1) ** 2))] = 10
    faint = (echoes.rcs < 0.25) & (echoes.r > 19) & (u < 0.95)
    state[faint & (_dice(echoes, 5, rng) < 0.5 + 0.05 * (-echoes.rcs))] = 4
    child = v < (0.02 if beam.far else 0.1) * (echoes.r > 12)
    state[child] = 9
    shoulder = (v > 0.1) & (v < 0.13 + np.minimum(0.1 * echoes.shoulder, 0.65))
    state[shoulder] = 11
    if beam.far:
        state[(echoes.r < 50) & ~confirmed] = 3
    state[(echoes.motion == Motion.MIRRORED) & (w < 0.5)] = 6
    state[outside] = 7
    return state, _PDH0[state]


def _ambiguity(
    echoes: Echoes, dyn: NDArray[np.uint8], pdh0: NDArray[np.uint8], rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Return AmbigState: unambiguous, but for a third of what moves and for invalid clusters."""
    state = np.full(len(dyn), 3, np.uint8)
    u = _dice(echoes, 6, rng)
    moving = (dyn == _MOVING) | (dyn == _ONCOMING)
    state[moving & (u < 0.40)] = 2
    state[moving & (u < 0.32)] = 1
    state[pdh0 == 6] = 0
    return state


def _rms(echoes: Echoes, beam: Beam) -> dict[str, Floats]:
    """Return the RMS indices: k where 0.005 · 2000^(k/30) is the standard deviation."""
    noise = 10 ** ((20.0 - echoes.snr) / 20)
    along = np.hypot(1.02 if beam.far else 0.62, 0.4 * noise)
    across = np.hypot(0.62, echoes.r * np.radians(0.6) * np.hypot(0.6, noise))
    cos, sin = np.abs(np.cos(echoes.azimuth)), np.abs(np.sin(echoes.azimuth))
    speed = 0.283 / np.maximum(cos, 0.2)
    std = {
        "x_rms": np.hypot(along * cos, across * sin),
        "y_rms": np.hypot(along * sin, across * cos),
        "vx_rms": speed,
        "vy_rms": np.full(len(echoes), 0.0107),
    }
    return {
        name: np.clip(np.rint(30 * np.log(value / 0.005) / np.log(2000)), 0, 30)
        for name, value in std.items()
    }
