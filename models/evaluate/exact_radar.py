"""What a radar degradation would give in more exact arithmetic: 64 bits of mantissa or more.

Written anew for this, by the laws alone. What is random is taken as it was drawn: the same deviates
in the same order.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.scan import RadarScan
from models.degrade import jammer, propagation, radar
from models.sensor import RadarSensor

Exact = NDArray[np.longdouble]

_RADIANS = np.arctan2(np.longdouble(0), np.longdouble(-1)) / 180


def exact_rows(drawn: Any, scan: RadarScan, sensor: RadarSensor) -> Exact:
    """Return the clusters that leave, (5, n) x, y (m), vx, vy (m/s), rcs (dBm²), off the grid.

    Parameters
    ----------
    drawn:
        What a kind's ``draw`` returned.
    scan:
        Of finite values, without quality.

    Raises
    ------
    KeyError
        If the degradation is none of a radar's.
    """
    rows = np.array([scan.x, scan.y, scan.vx, scan.vy, scan.rcs], np.longdouble)
    if drawn.level == 0 or not rows.size:
        return rows
    match drawn:
        case radar.RadarDegradation():
            return _with_less_signal(drawn, rows, sensor)
        case jammer.Jammer(kind="deception"):
            return _deceived(drawn, rows)
        case jammer.Jammer():
            return _jammed(drawn, rows, sensor)
        case propagation.Propagation(kind="multipath"):
            return _with_images(drawn, rows, scan, sensor)
        case propagation.Propagation(kind="blockage"):
            away = 6 * np.arctan2(rows[1], rows[0]) + drawn.phase
            loss = np.longdouble(drawn.attenuation_db) * np.longdouble(2) ** np.cos(away)
            kept = _echo(rows, sensor) - loss >= _threshold(rows, sensor)
            return np.asarray(np.vstack([rows[:4], rows[4] - loss])[:, kept])
        case propagation.Propagation():
            turn = np.exp(-1j * drawn.turn_deg * _RADIANS)
            place, velocity = (rows[0] + 1j * rows[1]) * turn, (rows[2] + 1j * rows[3]) * turn
            return np.array([place.real, place.imag, velocity.real, velocity.imag, rows[4]])
        case _:
            raise KeyError(drawn.kind)


def _range(rows: Exact) -> Exact:
    return np.asarray(np.sqrt(rows[0] ** 2 + rows[1] ** 2))


def _echo(rows: Exact, sensor: RadarSensor) -> Exact:
    distance = np.maximum(_range(rows), np.longdouble(sensor.range_min_m))
    return np.asarray(rows[4] - 40 * np.log10(distance))


def _threshold(rows: Exact, sensor: RadarSensor) -> np.longdouble:
    return np.longdouble(min(sensor.detection_floor_db, _echo(rows, sensor).min()))


def _detected(rows: Exact, drop_db: Any, spread: Any, deviates: Any, sensor: RadarSensor) -> Any:
    """Return which echoes are over the threshold after a loss, in units of the threshold.

    One that is on it to the last bit of float64 is.
    """
    over = (_echo(rows, sensor) - _threshold(rows, sensor) - drop_db) / 10
    return np.longdouble(10) ** np.minimum(over, 300) + spread * deviates >= 1 - 1e-15


def _scattered(rows: Exact, drop_db: Any, deviates: Any, sensor: RadarSensor) -> Exact:
    """Return the clusters after the Cramér–Rao bound's added spread."""
    gained = np.longdouble(10) ** (np.asarray(drop_db, np.longdouble) / 10) - 1
    growth = np.minimum(np.sqrt(gained), radar.MOST_GROWTH)
    distance, azimuth = _range(rows), np.arctan2(rows[1], rows[0])
    near = distance < sensor.near_accuracy_range_m
    std = np.where(near, sensor.near_range_std_m, sensor.far_range_std_m)
    nodes, table = sensor.azimuth_nodes_deg, sensor.near_azimuth_std_deg
    aside = np.where(near, _between(np.abs(azimuth) / _RADIANS, nodes, table),
                     np.longdouble(sensor.far_azimuth_std_deg)) * _RADIANS  # fmt: skip
    clamped = np.maximum(distance, np.longdouble(sensor.range_min_m))
    faster = growth * sensor.velocity_std * deviates[2] / clamped
    moved = np.maximum(distance + growth * std * deviates[0], np.longdouble(sensor.range_min_m))
    turned = azimuth + growth * aside * deviates[1]
    x, y = moved * np.cos(turned), moved * np.sin(turned)
    vx, vy = rows[2] + faster * rows[0], rows[3] + faster * rows[1]
    return np.array([x, y, vx, vy, rows[4]])


def _between(value: Exact, nodes: tuple[float, ...], table: tuple[float, ...]) -> Exact:
    """Return the value of a table that is linear between its nodes, constant beyond them."""
    result = np.full(value.shape, np.longdouble(table[-1]))
    for k in reversed(range(len(nodes) - 1)):
        slope = np.longdouble(table[k + 1] - table[k]) / np.longdouble(nodes[k + 1] - nodes[k])
        result = np.where(value <= nodes[k + 1], table[k] + slope * (value - nodes[k]), result)
    return result


def _with_less_signal(drawn: radar.RadarDegradation, rows: Exact, sensor: RadarSensor) -> Exact:
    normal = np.random.Generator(np.random.SFC64(drawn.seed)).standard_normal
    if drawn.kind in ("snr", "missed"):
        spread, deviates = drawn.level / 100, normal(rows.shape[1])
        rows = rows[:, _detected(rows, drawn.drop_db, spread, deviates, sensor)]
    if drawn.kind in ("snr", "jitter"):
        rows = _scattered(rows, drawn.drop_db, normal((3, rows.shape[1])), sensor)
    if not rows.size or not drawn.ghosts:
        return rows
    reach = _range(rows).max() + 10 - sensor.range_min_m
    ghosts = []
    for ghost in drawn.ghosts:
        distance = sensor.range_min_m + ghost.range_fraction * reach
        band = next(band for band in sensor.ghost_bands if distance < band.range_max_m)
        azimuth = ghost.azimuth_fraction * band.azimuth_deg * _RADIANS
        lender = rows[:, int(ghost.source_fraction * rows.shape[1])]
        ahead, aside = np.cos(azimuth), np.sin(azimuth)
        radial = lender[2] * ahead + lender[3] * aside
        rcs = np.sort(rows[4])[round(ghost.rcs_fraction * (rows.shape[1] - 1))]
        ghosts.append((distance * ahead, distance * aside, radial * ahead, radial * aside, rcs))
    return np.hstack([rows, np.array(ghosts, np.longdouble).T])


def _jammed(drawn: jammer.Jammer, rows: Exact, sensor: RadarSensor) -> Exact:
    if drawn.floor_db == 0:
        return rows
    generator = np.random.Generator(np.random.SFC64(drawn.seed))
    floor = np.full(rows.shape[1], np.longdouble(drawn.floor_db))
    if drawn.kind == "noise_jam":
        away = np.arctan2(rows[1], rows[0]) / _RADIANS - drawn.azimuth_deg
        floor *= np.exp(-((away / jammer.SECTOR_STD_DEG) ** 2) / 2)
    spread = 1 - np.longdouble(10) ** (-floor / 10)
    deviates = generator.standard_normal(rows.shape[1])
    kept = _detected(rows, floor, spread, deviates, sensor)
    rows, floor = rows[:, kept], floor[kept]
    rows = _scattered(rows, floor, generator.standard_normal((3, rows.shape[1])), sensor)
    if not drawn.ghosts or not rows.size:
        return rows
    along, speed, loud, _ = generator.random((4, drawn.ghosts)).astype(np.longdouble)
    reach = _range(rows).max() + 10 - sensor.range_min_m
    distance = sensor.range_min_m + reach * along
    resolution = np.where(distance < sensor.near_accuracy_range_m,
                          sensor.near_azimuth_resolution_deg[0],
                          sensor.far_azimuth_resolution_deg)  # fmt: skip
    width = sensor.far_azimuth_std_deg + np.asarray(resolution, np.longdouble) / 2
    aim = drawn.azimuth_deg + width * generator.standard_normal(drawn.ghosts)
    azimuth = aim * _RADIANS
    radial = jammer.BURST_SPEED * (2 * speed - 1)
    rcs = np.sort(rows[4])[(loud * rows.shape[1]).astype(int)]
    ahead, aside = np.cos(azimuth), np.sin(azimuth)
    burst = [distance * ahead, distance * aside, radial * ahead, radial * aside, rcs]
    return np.hstack([rows, np.array(burst)])


def _deceived(drawn: jammer.Jammer, rows: Exact) -> Exact:
    if drawn.pull_m == 0:
        return rows
    azimuth = np.arctan2(rows[1], rows[0])
    away = np.abs(azimuth / _RADIANS - drawn.azimuth_deg) / jammer.SECTOR_STD_DEG
    target = rows[:2, np.argmax(rows[4] - away**2), None]
    hit = _range(rows[:2] - target) <= jammer.TARGET_SIZE_M
    ahead, aside = hit * np.cos(azimuth), hit * np.sin(azimuth)
    pull, speed = np.longdouble(drawn.pull_m), np.longdouble(drawn.pull_speed)
    moved = [rows[0] + pull * ahead, rows[1] + pull * aside]
    return np.array([*moved, rows[2] + speed * ahead, rows[3] + speed * aside, rows[4]])


def _with_images(
    drawn: propagation.Propagation, rows: Exact, scan: RadarScan, sensor: RadarSensor
) -> Exact:
    generator = np.random.Generator(np.random.SFC64(drawn.seed))
    moving = np.isin(scan.dyn_prop, (0, 2, 6))
    chosen = rows[:, moving & (generator.random(rows.shape[1]) < drawn.share)]
    twice = np.vstack([2 * chosen[:4], chosen[4] - propagation.BOUNCE_LOSS_DB])
    found = [twice]
    rail = _rail(rows[1, ~moving])
    if rail is not None:
        x, y, vx, vy, rcs = chosen[:, np.abs(chosen[1]) < abs(rail)]
        line = x + 1j * (2 * rail - y)
        line = line / np.maximum(np.abs(line), np.longdouble(1e-9))
        radial = line * (vx * line.real - vy * line.imag)
        mirror = [x, 2 * rail - y, radial.real, radial.imag, rcs - propagation.MIRROR_LOSS_DB]
        found.append(np.array(mirror))
    images = np.hstack(found)
    distance = _range(images)
    azimuth = np.abs(np.arctan2(images[1], images[0])) / _RADIANS
    reach = _between(azimuth, sensor.azimuth_nodes_deg, sensor.near_range_m)
    near = (azimuth <= sensor.near_azimuth_deg) & (distance <= reach)
    far = (azimuth <= sensor.far_azimuth_deg) & (distance <= sensor.range_max_m)
    loud = _echo(images, sensor) >= _threshold(rows, sensor)
    heard = (near | far) & (distance >= sensor.range_min_m) & loud
    return np.hstack([rows, images[:, heard]])


def _rail(y: Exact) -> np.longdouble | None:
    """Return the median of the fullest metre between 2 and 12 m aside, where five stand there."""
    beside = y[(np.abs(y) >= 2) & (np.abs(y) <= 12)]
    metres, counts = np.unique(np.rint(beside), return_counts=True)
    if not len(counts) or counts.max() < 5:
        return None
    return np.longdouble(np.median(beside[np.rint(beside) == metres[np.argmax(counts)]]))
