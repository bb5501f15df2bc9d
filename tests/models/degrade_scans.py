"""Radar scans for the tests of degradation: made up by hypothesis, or read from real logs."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from drivers.scan import RadarScan
from models.sensor import ARS408

QUALITY = ("x_rms", "y_rms", "vx_rms", "vy_rms", "pdh0", "ambig_state", "invalid_state")


def make_scan(
    x: Any,
    y: Any,
    vx: Any = 0.0,
    vy: Any = 0.0,
    rcs: Any = 5.0,
    near: int | None = None,
    **fields: Any,
) -> RadarScan:
    x = np.atleast_1d(np.asarray(x, np.float32))
    n = len(x)

    def column(values: Any) -> Any:
        return np.broadcast_to(np.asarray(values, np.float32), (n,)).copy()

    near = n if near is None else near
    header: dict[str, Any] = {"sensor": "radar", "sensor_id": 0, "sequence": 7, "stamp_ns": 1}
    header |= {"stamp_source": "simulated", "mode": "cluster", "meas_counter": 14}
    header |= {"near": near, "far": n - near, "id": np.arange(n, dtype=np.uint8)}
    header |= {"x": x, "y": column(y), "vx": column(vx), "vy": column(vy), "rcs": column(rcs)}
    header |= {"dyn_prop": np.zeros(n, np.uint8)}
    return RadarScan(**(header | fields))


@st.composite
def scans(draw: st.DrawFn) -> RadarScan:
    """Any scan that the bus can carry: values on the grid, each list sorted by range."""
    quality = draw(st.booleans())
    limit = ARS408.max_clusters_with_quality if quality else ARS408.max_clusters
    n = draw(st.integers(0, limit))
    seed = np.random.default_rng(draw(st.integers(0, 2**32)))
    spread = draw(st.sampled_from([1.0, 30.0, 250.0]))
    rows = np.array(
        [
            seed.uniform(0, spread, n),
            seed.uniform(-spread, spread, n) / 3,
            seed.normal(-5, 8, n),
            seed.normal(0, 2, n),
            seed.uniform(-5, 30, n),
        ]
    )
    x, y, vx, vy, rcs = ARS408.rows_to_grid(rows).astype(np.float32)
    near = draw(st.integers(0, n))
    order = np.lexsort((np.hypot(x, y), np.arange(n) >= near))
    fields = {}
    if quality:
        fields = {
            name: draw(hnp.arrays(np.uint8, n, elements=st.integers(0, 6))) for name in QUALITY
        }
    return make_scan(x[order], y[order], vx[order], vy[order], rcs[order], near, **fields)


def real_scans(data: Path, name: str = "scene-0061.npz") -> list[RadarScan]:
    archive = np.load(data / "radar" / "nuscenes_mini" / name)
    columns = {str(field): k for k, field in enumerate(archive["fields"])}
    offsets = archive["offsets"]
    made = []
    for first, last in pairwise(offsets):
        points = archive["points"][first:last]

        def column(field: str, points: Any = points) -> Any:
            return points[:, columns[field]].copy()

        quality = {field: column(field).astype(np.uint8) for field in QUALITY}
        made.append(make_scan(*map(column, ("x", "y", "vx", "vy", "rcs")), **quality))
    return made
