"""What the tests of data sets share: running a plan, the command, and a folder's bytes."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from drivers.nuscenes import POINT, cloud_bytes, new_cloud
from node.dataset.job import run_job
from node.dataset.labels import write_labels
from node.dataset.plan import Plan, begin

MURK = [sys.executable, "-c", "from node.cli import main; main()", "degrade"]


def write_clouds(folder: Path, scans: list[Any]) -> None:
    folder.mkdir(parents=True)
    for number, scan in enumerate(scans):
        points = np.zeros(len(scan), POINT)
        for name in ("id", "x", "y", "vx", "vy", "rcs", "dyn_prop", "pdh0", "invalid_state"):
            points[name] = getattr(scan, name)
        (folder / f"scan{number}.pcd").write_bytes(cloud_bytes(new_cloud(points)))


def run_all(plan: Plan) -> Plan:
    for job in begin(plan):
        run_job(job)
    write_labels(plan)
    return plan


def tree(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def digests(folder: Path) -> dict[str, str]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in paths
    }


def murk(*arguments: object, timeout: float = 120) -> subprocess.CompletedProcess[str]:
    command = [*MURK, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout)


def one_line(result: subprocess.CompletedProcess[str]) -> str:
    assert result.returncode == 2, result.stderr
    assert len(result.stderr.splitlines()) == 1, result.stderr
    return result.stderr
