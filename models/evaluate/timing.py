"""Run times and CPU times, and where real data lies."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from time import perf_counter, thread_time_ns

import cv2


def median_us(task: Callable[[], object], rounds: int) -> float:
    """Return the median run time of a task after one that does not count, microseconds."""
    task()
    times = []
    for _ in range(rounds):
        start = perf_counter()
        task()
        times.append(perf_counter() - start)
    return median(times) * 1e6


def cpu_time_us(call: Callable[[], object], quick: bool) -> float:
    """Return the median CPU time of a call, µs, after one call to warm up."""
    call()
    times = []
    for _ in range(3 if quick else 21):
        start = thread_time_ns()
        call()
        times.append(thread_time_ns() - start)
    return median(times) / 1e3


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep OpenCV to one thread."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def camera_data() -> Path | None:
    """Return the folder of real recordings: ``MURK_DATA``, or beside the checkout; else None."""
    return _data("camera/index.csv")


def recordings() -> Path | None:
    """Return the same folder where it has recorded radar drives; else None."""
    return _data("radar/nuscenes_mini")


def _data(holding: str) -> Path | None:
    beside = Path(__file__).resolve().parents[2].parent / "shared" / "data"
    data = Path(os.environ.get("MURK_DATA") or beside)
    return data if (data / holding).exists() else None
