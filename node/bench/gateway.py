"""What it costs to pass a full bus through the gateway; see ``node.bench.bus``."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from statistics import median
from threading import Event, Thread
from typing import NamedTuple

import numpy as np

from drivers.ars408 import ScanAssembler
from drivers.can_bus import CanBus, open_bus
from drivers.can_frames import CanFrames, concatenate
from drivers.scan import RadarScan
from models.evaluate.report import Goal, Point
from models.sensor import ARS408
from node.bench.bus import CLUSTERS, FULL_LOAD, LISTEN_S, has_socketcan
from node.bench.decode import simulated_log
from node.gateway_bus import CanLink
from node.gateway_levels import GatewayLevels
from node.gateway_scene import build_gateway_scene

SLICE_FRAMES = 4
"""Frames sent at once, a millisecond of the full load."""
MODES = {"wire": (0, False), "whole scans": (60, False), "low latency": (60, True)}
"""Level of snr, %, and whether each cluster is sent when it comes."""
CLUSTER_IDS = (0x600, 0x701, 0x702)


class Passage(NamedTuple):
    """What became of a stream in the gateway: CPU and latencies in µs, a frame."""

    cpu_us: float
    p50_us: float
    p99_us: float
    lost: int


def run(quick: bool) -> Iterator[Point | Goal]:
    """Pass a full bus through the gateway, untouched and degraded."""
    transport = "SocketCAN" if has_socketcan() else "python-can virtual"
    buses = ("vcan0", "vcan1") if has_socketcan() else ("virtual:bench0", "virtual:bench1")
    rounds, seconds = (1, 3) if quick else (5, 10)
    cycles = seconds * FULL_LOAD // (CLUSTERS + 1)
    frames = simulated_log(CLUSTERS, quality=False, cycles=cycles)
    unit = f"frames lost ({transport})"
    for mode, (level, low_latency) in MODES.items():
        with _one_core_of_its_own():
            passages = [_pass(frames, buses, level, low_latency) for _ in range(rounds)]
        passage = _typical(passages)
        knob = f"{mode}, snr={level}"
        yield Point("gateway, CPU", knob, passage.cpu_us, passage.lost, unit)
        yield Point("gateway, added latency p50", knob, passage.p50_us, passage.lost, unit)
        yield Point("gateway, added latency p99", knob, passage.p99_us, passage.lost, unit)
        load = f"of {FULL_LOAD} frames/s through the gateway, {mode} ({transport})"
        yield Goal(f"frames lost {load}", passage.lost, 0, at_least=False)
        cycle_ms = ARS408.cycle_s * 1e3
        late_ms = passage.p99_us / 1e3
        yield Goal(f"added latency p99, ms, {load}", late_ms, cycle_ms, at_least=False)
        share = passage.cpu_us * 1e-6 * FULL_LOAD
        yield Goal(f"share of a core {load}", share, 1.0, at_least=False)


def _typical(passages: list[Passage]) -> Passage:
    """Return medians, and all frames that were lost."""
    cpu_us, p50_us, p99_us, lost = zip(*passages, strict=True)
    return Passage(median(cpu_us), median(p50_us), median(p99_us), sum(lost))


@contextmanager
def _one_core_of_its_own() -> Iterator[None]:
    """Keep this thread, and those that it starts, on one core, before all else that runs there.

    The garbage collector is off: it would walk through all that the hearer keeps.
    """
    cores, policy = os.sched_getaffinity(0), os.sched_getscheduler(0)
    os.sched_setaffinity(0, {min(cores)})
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        os.sched_setscheduler(0, policy, os.sched_param(0))
        os.sched_setaffinity(0, cores)


def _pass(frames: CanFrames, buses: tuple[str, str], level: float, low_latency: bool) -> Passage:
    """Send frames at the full load through a gateway, and hear what comes out."""
    scene = build_gateway_scene(None, "radar", buses[0], inject=[f"radar:snr:{level}"])
    levels = GatewayLevels(scene.sensor, scene.injections, scene.faults, scene.seed)
    stop, ended = Event(), Event()
    link = CanLink(scene, levels, buses[1], stop, both_ways=False, low_latency=low_latency)
    cpu_s: list[float] = []
    heard: list[CanFrames] = []

    def run_link() -> None:
        link.run()
        cpu_s.append(time.thread_time())

    def listen(bus: CanBus) -> None:
        while not ended.is_set() or (heard and len(heard[-1])):
            heard.append(bus.read(LISTEN_S))

    with open_bus(buses[0]) as radar, open_bus(buses[1]) as receiver:
        runner = Thread(target=run_link)
        listener = Thread(target=listen, args=(receiver,))
        listener.start()
        runner.start()
        _send_paced(radar, frames)
        time.sleep(LISTEN_S)
        stop.set()
        runner.join()
        ended.set()
        listener.join()
    summary = link.summary()
    return Passage(
        cpu_us=cpu_s[0] * 1e6 / len(frames),
        p50_us=summary["latency_p50_ns"] / 1e3,
        p99_us=summary["latency_p99_ns"] / 1e3,
        lost=_lost(frames, concatenate(heard)),
    )


def _send_paced(bus: CanBus, frames: CanFrames) -> None:
    start_s = time.monotonic()
    for first in range(0, len(frames), SLICE_FRAMES):
        time.sleep(max(0.0, start_s + first / FULL_LOAD - time.monotonic()))
        bus.send(frames.select(slice(first, first + SLICE_FRAMES)))


def _lost(sent: CanFrames, heard: CanFrames) -> int:
    """Return announced frames that did not come, whole scans that did not, and others."""
    before, after = _scans(sent), _scans(heard)
    inside = sum(scan.frames_lost for scan in after)
    whole = (len(before) - len(after)) * (CLUSTERS + 1)
    return inside + whole + _others(sent) - _others(heard)


def _scans(frames: CanFrames) -> list[RadarScan]:
    assembler = ScanAssembler()
    items = [*assembler.feed(frames), *assembler.flush()]
    return [item for item in items if isinstance(item, RadarScan)]


def _others(frames: CanFrames) -> int:
    """Return how many frames are of no cluster list."""
    return int(np.count_nonzero(~np.isin(frames.can_id, CLUSTER_IDS)))
