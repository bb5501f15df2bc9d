from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from dbc.errors import InputError, MissingExtra
from models.world.camera import WorldCamera
from models.world.road import World
from node.dataset import workers
from node.dataset.plan import make_plan
from tests.node.datasets import MURK, run_all, tree


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtra, match="scale"), workers.dask_workers("tcp://127.0.0.1:1"):
        pass


def process(*arguments: object) -> subprocess.Popen[bytes]:
    quiet = subprocess.DEVNULL
    command = [sys.executable, "-m", *map(str, arguments)]
    return subprocess.Popen(command, stdout=quiet, stderr=quiet)


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_cluster_that_loses_a_worker_gives_the_same(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="needs the extra scale")
    view = WorldCamera(World(2, 3.0), width=640, height=360)
    (tmp_path / "in").mkdir()
    for number in range(2):
        cv2.imwrite(str(tmp_path / "in" / f"{number}.png"), view.frame(number).image)
    kinds, levels = ["noise", "motion"], [10.0 * n for n in range(1, 11)]
    address = tmp_path / "scheduler.json"
    local = ("--host", "127.0.0.1", "--scheduler-file", address, "--no-dashboard")
    worker = ("distributed.cli.dask_worker", "--scheduler-file", address, "--no-dashboard",
              "--nthreads", 1, "--no-nanny", "--local-directory", tmp_path)  # fmt: skip
    running = [process("distributed.cli.dask_scheduler", "--port", 0, *local)]
    try:
        wait_for(address.exists)
        running += [process(*worker), process(*worker)]
        flags = [f"--kind={kind}" for kind in kinds] + [f"--level={level}" for level in levels]
        tcp = json.loads(address.read_text())["address"]
        command = [*MURK, tmp_path / "in", tmp_path / "far", *flags, "--scheduler", tcp, "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
            assert run.stdout is not None
            for _ in range(5):
                run.stdout.readline()
            running[-1].kill()
            done = len(list((tmp_path / "far" / ".murk" / "labels").rglob("*.jsonl")))
            *_, last = run.stdout.read().splitlines()
    finally:
        for one in running:
            one.kill()
            one.wait()
    assert done < 2 * len(kinds) * len(levels)
    summary = json.loads(last)
    assert (summary["complete"], summary["files"]) == (True, 40)
    near = run_all(make_plan(tmp_path / "in", tmp_path / "near", kinds, levels, 1))
    assert tree(tmp_path / "far") == tree(near.output)


def test_no_scheduler_is_an_input_error(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="needs the extra scale")
    monkeypatch.setattr(workers, "CONNECT_S", 0.5)
    for address in ("tcp://127.0.0.1:1", "nonsense://x"):
        with pytest.raises(InputError, match=address), workers.dask_workers(address):
            pass
