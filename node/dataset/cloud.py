"""Jobs on radar scans of nuScenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drivers.nuscenes import cloud_bytes, read_cloud, scan_of, with_scan
from models.degrade.compensation import compensate
from node.dataset.job import Job


def degrade(job: Job, path: Path) -> list[dict[str, Any]]:
    """Write the degraded scan in the data set's form; return its label.

    A scan to which nothing happens is copied byte by byte.

    Raises
    ------
    InputError
        If the file is not a radar scan of nuScenes.
    """
    source = job.source
    cloud = read_cloud(source.path)
    scan = scan_of(cloud, source.sensor, source.sequence, source.path)
    degraded, label = job.degrade(scan, source.sensor, source.sequence)
    if degraded is scan:
        path.write_bytes(source.path.read_bytes())
    else:
        changed = compensate(cloud, with_scan(cloud, degraded), degraded.place)
        path.write_bytes(cloud_bytes(changed))
    return [label]
