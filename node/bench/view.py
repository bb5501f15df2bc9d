"""What the page costs: CPU time of its thread, by how many browsers watch.

A simulated radar (13.9 Hz) and camera (12.5 Hz) run in real time; the viewers are WebSocket clients
in another process, which take every snapshot (ten a second, each with the scan) and every
thumbnail. A run time is CPU time of the server's thread a snapshot, made and sent to all; an error
is the messages that the pipeline dropped meanwhile. Without the extra `view` nothing is measured.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from importlib.util import find_spec
from multiprocessing import get_context
from multiprocessing.synchronize import Event as ProcessEvent
from time import clock_gettime, monotonic, pthread_getcpuclockid

from models.evaluate.report import Goal, Point
from node.bus.in_process import Bus
from node.bus.web import WebView
from node.pipeline import Pipeline
from node.plan import plan
from node.scene import check_scene

VIEWERS = (0, 1, 10)
SENSORS = ("radar", "camera")


def run(quick: bool) -> Iterator[Point | Goal]:
    """Measure the server's thread with no, one and ten viewers."""
    if find_spec("aiohttp") is None:
        return
    share, dropped = 0.0, 0
    for viewers in VIEWERS:
        cpu_us, share, dropped = _measure(viewers, duration_s=3.0 if quick else 12.0)
        yield Point("page", f"viewers={viewers}", cpu_us, dropped, "messages dropped")
    yield Goal("page, CPU time with ten viewers, % of a core", 100 * share, 10.0, False)
    yield Goal("page, messages dropped with ten viewers", dropped, 0.0, False)


def _measure(viewers: int, duration_s: float) -> tuple[float, float, int]:
    """Return CPU time of the server's thread a snapshot (µs) and a second (s), and drops."""
    content = {
        "sensors": [{"name": name, "type": name, "source": "world"} for name in SENSORS],
        "duration_s": duration_s,
        "outputs": {"view": {"port": 0}},
    }
    context = get_context("spawn")
    watching, done = context.Event(), context.Event()
    with Bus() as bus:
        pipeline = Pipeline(plan(check_scene(content, "bench")), bus)
        view = WebView(pipeline.plan, bus, pipeline.set_injection)
        arguments = (view.url + "live", viewers, watching, done)
        clients = context.Process(target=_watch, args=arguments, daemon=True)
        clients.start()
        watching.wait()
        clock = pthread_getcpuclockid(view.thread_id)
        before = view.counts()["snapshots"]
        start_s, cpu_s = monotonic(), clock_gettime(clock)
        for _ in pipeline.run():
            pass
        wall_s, cpu_s = monotonic() - start_s, clock_gettime(clock) - cpu_s
        snapshots = view.counts()["snapshots"] - before
        done.set()
        clients.join()
        view.close()
    counts = pipeline.summary()["sensors"].values()
    dropped = sum(one["dropped_by_queue"] for one in counts)
    return cpu_s / max(1, snapshots) * 1e6, cpu_s / wall_s, dropped


def _watch(url: str, count: int, watching: ProcessEvent, done: ProcessEvent) -> None:
    """Open so many viewers, and let them take what comes until done."""
    asyncio.run(_watch_all(url, count, watching, done))


async def _watch_all(url: str, count: int, watching: ProcessEvent, done: ProcessEvent) -> None:
    import aiohttp

    async def take(viewer: aiohttp.ClientWebSocketResponse) -> None:
        async for _ in viewer:
            pass

    async with aiohttp.ClientSession() as session:
        viewers = [await session.ws_connect(url) for _ in range(count)]
        taking = [asyncio.create_task(take(viewer)) for viewer in viewers]
        watching.set()
        await asyncio.to_thread(done.wait)
        for task in taking:
            task.cancel()
