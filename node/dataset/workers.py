"""Who does the jobs: the cores of this machine, or a Dask cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from importlib import import_module
from threading import Thread
from typing import Any

from dbc.errors import InputError, MissingExtra, MurkError, and_others
from node.dataset.job import Done, Job, run_job

CONNECT_S = 10
"""How long to wait for a cluster."""


def do_jobs(jobs: list[Job], executor: Executor) -> Iterator[Done]:
    """Do the jobs; yield each as it is done. All that can be done is, whatever else fails.

    Raises
    ------
    InputError
        In the end, for the first job (in their order) whose file cannot be read or written.
    MurkError
        If a process of this machine died.
    """
    futures: dict[Future[Done], int] = {
        executor.submit(run_job, job): number for number, job in enumerate(jobs)
    }
    failures: dict[int, InputError] = {}
    for future in as_completed(futures):
        try:
            yield future.result()
        except InputError as error:
            failures[futures[future]] = error
        except BrokenProcessPool:
            what = "a worker process died (out of memory?); give the command again to go on"
            raise MurkError(what) from None
    if failures:
        first = failures[min(failures)]
        names = list(dict.fromkeys(jobs[number].source.target for number in sorted(failures)))
        raise type(first)(first.where, first.what + and_others(names[1:]), first.remedy)


@contextmanager
def local_workers(count: int | None = None) -> Iterator[Executor]:
    """Give ``count`` processes; None: one a core that this one may use."""
    executor = ProcessPoolExecutor(
        count or len(os.sched_getaffinity(0)),
        mp_context=multiprocessing.get_context("spawn"),  # fork would copy other threads' locks
        initializer=_prepare,
    )
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)


@contextmanager
def dask_workers(address: str) -> Iterator[Executor]:
    """Give the workers of a Dask cluster; they must see the same files under the same names.

    Raises
    ------
    MissingExtra
        If Dask is not installed.
    InputError
        If no scheduler answers there.
    MurkError
        If the scheduler goes away, or a job kills one worker after another.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise MissingExtra("scale", "--scheduler") from error
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what goes wrong is raised
    try:
        client = distributed.Client(address, timeout=CONNECT_S)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(address, "no Dask scheduler answers", "tcp://HOST:PORT") from error
    try:
        yield client.get_executor(pure=False)
    except (distributed.KilledWorker, CancelledError):
        what = f"{address}: the cluster was lost; give the command again to go on"
        raise MurkError(what) from None
    finally:
        client.close()


def _prepare() -> None:
    """Leave Ctrl-C to the parent, and end where it ends, even where it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
