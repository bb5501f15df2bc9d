"""What is said of scans that no radar should send."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from drivers.scan import RadarScan
from models.estimate.radar import RadarEstimator
from models.evaluate.report import Table
from models.evaluate.samples import full_scan


def extremes() -> dict[str, RadarScan]:
    """Return scans that no radar should send, by name."""
    full = full_scan()
    n = len(full)
    same: dict[str, Any] = {
        name: np.full_like(values, values[n // 2]) for name, values in full.arrays().items()
    }
    flat = np.zeros_like(full.y)
    return {
        "0 clusters": _first(full, 0),
        "1 cluster": _first(full, 1),
        "2 clusters": _first(full, 2),
        "250 clusters": full,
        "250 clusters in one place": replace(full, **same),
        "all at 0.2 m": replace(full, x=np.full_like(full.x, 0.2), y=flat),
        "all at 250 m": replace(full, x=np.full_like(full.x, 250.0), y=flat),
        "all of -64 dBm²": replace(full, rcs=np.full_like(full.rcs, -64.0)),
        "all of 63.5 dBm²": replace(full, rcs=np.full_like(full.rcs, 63.5)),
        "all of 1000 dBm²": replace(full, rcs=np.full_like(full.rcs, 1000.0)),
        "all of NaN": replace(full, x=np.full_like(full.x, np.nan)),
    }


def extremes_table(estimator: RadarEstimator) -> Table:
    """Return what is said of them, each by itself."""
    rows = []
    for name, scan in extremes().items():
        estimate = estimator.estimate(scan)
        rows.append((name, estimate.level, estimate.std, estimate.kind))
    columns = ("scan", "level, %", "standard deviation, points", "kind")
    return Table("Radar: scans that no radar should send", columns, tuple(rows))


def _first(scan: RadarScan, count: int) -> RadarScan:
    columns: dict[str, Any] = {name: values[:count] for name, values in scan.arrays().items()}
    return replace(scan, near=count, **columns)
