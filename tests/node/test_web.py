from __future__ import annotations

import asyncio
import socket
import subprocess
import sys
from collections.abc import Callable
from threading import Thread
from time import sleep
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="needs the extra 'view'")

import aiohttp

from models.world.radar import WorldRadar
from models.world.road import World
from node.bus import web_server
from node.bus.in_process import Bus
from node.bus.web import WebView
from node.bus.web_broadcast import Broadcaster
from node.bus.web_feed import Feed
from node.events import EVENT_TOPIC, MODEL_TOPIC, STATE_TOPIC, ModelChoice, NodeEvent, NodeState
from node.health import SensorEvent
from node.pipeline import Pipeline
from node.plan import plan
from node.scene import check_scene
from tests.node.web_views import (
    NOISE,
    SENSORS,
    UPGRADE,
    Injections,
    frame,
    level_of,
    news,
    serving,
    thumbnail,
    until,
    view_plan,
)

LEVEL = "/murk/camera/noise_level"
IMAGE = "/murk/camera/image"


def test_a_viewer_gets_everything_and_then_what_is_new() -> None:
    with Bus() as bus, serving(bus) as view:
        bus.publish(LEVEL, level_of("camera", 55.0))
        bus.publish(MODEL_TOPIC, ModelChoice("detector", 1, "radar only", "", "camera at 55 %"))
        bus.publish(STATE_TOPIC, NodeState("scene", 1, "active", 6))
        bus.publish("/murk/radar/event", SensorEvent("radar", 1, "stale", "silent for 1 s"))
        until(lambda: view._feed.full(0)["sensors"]["camera"]["points"])
        until(lambda: len(view._feed.full(0)["events"]) == 2)

        async def watch() -> None:
            async with (
                aiohttp.ClientSession() as session,
                session.ws_connect(view.url + "live") as viewer,
            ):
                full = await news(viewer, "full")
                sensors = {sensor["name"]: sensor for sensor in full["scene"]["sensors"]}
                assert "blur" in sensors["camera"]["kinds"]
                assert sensors["radar"]["kinds"] == []  # the scene injects nothing into it
                camera = full["sensors"]["camera"]
                assert (camera["level"], camera["std"]) == (55.0, 2.0)
                assert camera["injected"] == {"noise": 60.0}
                assert camera["kinds"] == {"clean": 0.1, "noise": 0.9}
                assert (camera["dropped"], camera["p50"]) == (4, 3.0)
                assert camera["points"][0][1:] == [55.0, 2.0, 60.0]
                assert full["sensors"]["radar"]["health"] == "stale"
                assert full["models"]["detector"]["model"] == "radar only"
                assert full["models"]["detector"]["reason"] == "camera at 55 %"
                assert (full["node"]["state"], full["node"]["sequence"]) == ("active", 6)
                first = await news(viewer, "update")
                sleep(0.1)  # the history takes a point in so long
                bus.publish(LEVEL, level_of("camera", 20.0))
                while first["sensors"]["camera"]["level"] != 20.0:
                    second = await news(viewer, "update")
                    assert second["tick"] == first["tick"] + 1
                    first = second
                assert [20.0, 2.0, 60.0] in [p[1:] for p in first["sensors"]["camera"]["points"]]
                assert first["events"] == []

        asyncio.run(watch())


def test_nothing_is_made_while_nobody_watches() -> None:
    with Bus() as bus, serving(bus) as view:
        for sequence in range(20):
            bus.publish(IMAGE, frame(sequence=sequence))
            bus.publish(LEVEL, level_of("camera", 1.0, sequence))
            sleep(0.02)
        counts = view.counts()
        assert (counts["snapshots"], counts["thumbnails"]) == (0, 0)


def test_a_frame_is_encoded_once_for_all_viewers() -> None:
    with Bus() as bus, serving(bus) as view:
        bus.publish(IMAGE, frame(90))

        async def watch() -> list[bytes]:
            async with aiohttp.ClientSession() as session:
                viewers = [await session.ws_connect(view.url + "live") for _ in range(10)]
                return await asyncio.gather(*map(thumbnail, viewers))

        thumbnails = asyncio.run(watch())
        assert view.counts()["thumbnails"] == 1
        assert len(set(thumbnails)) == 1
        assert thumbnails[0][0] == 1  # the camera is the second sensor
        image = cv2.imdecode(np.frombuffer(thumbnails[0][1:], np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert abs(float(image.mean()) - 90) < 2


def test_a_scan_is_sent_once_and_whole_to_who_comes_later() -> None:
    scan = next(WorldRadar(World(seed=1, duration_s=1.0)).scans())
    with Bus() as bus:
        feed = Feed(view_plan(), bus)
        bus.publish("/murk/radar/scan", scan)
        sent = feed.update(1, 0, 0)["sensors"]["radar"]["scan"]
        assert np.allclose(np.array(sent["x"]) / 10, scan.x, atol=0.051)
        assert np.allclose(np.array(sent["vy"]) / 10, scan.vy, atol=0.051)
        assert np.allclose(sent["rcs"], scan.rcs, atol=0.51)
        assert "scan" not in feed.update(2, 0, 0)["sensors"]["radar"]
        assert feed.full(2)["sensors"]["radar"]["scan"] == sent


def test_a_value_that_cannot_be_sent_is_counted_and_the_page_goes_on() -> None:
    with Bus() as bus, serving(bus) as view:

        async def talk(viewer: aiohttp.ClientWebSocketResponse) -> None:
            await news(viewer, "update")
            bus.publish(LEVEL, level_of("camera", float("nan")))
            await asyncio.to_thread(until, lambda: view.counts()["failures"] > 0)
            bus.publish(LEVEL, level_of("camera", 30.0))
            while (await news(viewer, "update"))["sensors"]["camera"].get("level") != 30.0:
                pass

        converse(view, talk)


class SlowViewer:
    """Takes the first snapshot, and then no more until it is let."""

    closed = False

    def __init__(self) -> None:
        self.taken: list[str] = []
        self.free = asyncio.Event()

    async def send_str(self, text: str) -> None:
        self.taken.append(text)
        await self.free.wait()

    async def send_bytes(self, data: bytes) -> None:
        pass


def test_a_slow_viewer_gets_the_newest_and_holds_up_nobody() -> None:
    async def watch(broadcaster: Broadcaster) -> SlowViewer:
        slow, quick = SlowViewer(), SlowViewer()
        quick.free.set()
        viewers: list[Any] = [slow, quick]
        tasks = [asyncio.create_task(broadcaster.follow(viewer)) for viewer in viewers]
        tasks.append(asyncio.create_task(broadcaster.run()))
        async with asyncio.timeout(30):
            while len(quick.taken) < 6:
                await asyncio.sleep(0.01)
            assert len(slow.taken) == 1
            slow.free.set()
            while len(slow.taken) < 3:
                await asyncio.sleep(0.01)
        for task in tasks:
            task.cancel()
        assert all('"type":"update"' in text for text in quick.taken[1:])
        return slow

    with Bus() as bus:
        broadcaster = Broadcaster(Feed(view_plan(), bus), bus)
        slow = asyncio.run(watch(broadcaster))
    assert '"type":"full"' in slow.taken[1]
    assert '"type":"update"' in slow.taken[2]
    assert broadcaster.counts["skipped"] >= 4


def converse(view: WebView, talk: Callable[[aiohttp.ClientWebSocketResponse], Any]) -> Any:
    async def run() -> Any:
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(view.url + "live") as viewer,
        ):
            return await talk(viewer)

    return asyncio.run(run())


def test_injection_requests_are_done_or_refused_with_the_reason_and_the_viewer_stays() -> None:
    asked = Injections()
    with Bus() as bus, serving(bus, asked) as view:
        said = bus.subscribe(EVENT_TOPIC)

        async def talk(viewer: aiohttp.ClientWebSocketResponse) -> None:
            request = {"id": 1, "sensor": "camera", "kind": "noise", "level": 60}
            await viewer.send_json(request)
            assert await news(viewer, "answer") == {"type": "answer", "id": 1, "ok": True}
            await viewer.send_json(request | {"id": 2, "level": None})
            assert (await news(viewer, "answer"))["ok"]
            await viewer.send_json(request | {"id": 3, "kind": "gremlins"})
            refused = await news(viewer, "answer")
            assert (refused["id"], refused["ok"], refused["where"]) == (3, False, "camera")
            assert "gremlins" in refused["what"]
            for text in ("{", '{"id": 4}'):
                await viewer.send_str(text)
                refused = await news(viewer, "answer")
                assert not refused["ok"]
                assert "expected" in refused["remedy"]
            await viewer.send_bytes(b"\x00")
            assert not (await news(viewer, "answer"))["ok"]
            await news(viewer, "update")

        converse(view, talk)
        assert asked.asked == [("camera", "noise", 60), ("camera", "noise", None)]
        assert (view.counts()["injections"], view.counts()["malformed"]) == (2, 4)
        event = next(iter(said))
        assert isinstance(event, NodeEvent)
        assert event.source == "view"
        assert "gremlins" in event.detail


def test_a_viewer_that_floods_is_closed_counted_and_said_and_others_stay() -> None:
    with Bus() as bus, serving(bus) as view:
        said = bus.subscribe(EVENT_TOPIC, depth=100)

        async def flood(viewer: aiohttp.ClientWebSocketResponse) -> None:
            with_error = aiohttp.WSMsgType.ERROR
            ended = (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED, with_error)
            try:
                for _ in range(5000):
                    await viewer.send_str("{}")
            except (ConnectionError, aiohttp.ClientError):
                return
            async with asyncio.timeout(30):
                while (await viewer.receive()).type not in ended:
                    pass

        async def run() -> None:
            async with (
                aiohttp.ClientSession() as session,
                session.ws_connect(view.url + "live") as calm,
            ):
                async with session.ws_connect(view.url + "live") as wild:
                    await flood(wild)
                for _ in range(3):
                    await news(calm, "update")

        asyncio.run(run())
        counts = view.counts()
        assert counts["floods"] == 1
        assert counts["malformed"] < 2 * web_server.MESSAGES_BURST
        said.close()
        details = [event.detail for event in said]
        assert len(details) <= 7  # the flood does not go on in the events


def test_a_message_that_is_too_long_ends_its_viewer_alone() -> None:
    with Bus() as bus, serving(bus) as view:

        async def run() -> None:
            async with (
                aiohttp.ClientSession() as session,
                session.ws_connect(view.url + "live") as other,
            ):
                async with session.ws_connect(view.url + "live") as viewer:
                    await viewer.send_str("x" * (web_server.LONGEST_MESSAGE + 1))
                    async with asyncio.timeout(30):
                        while (await viewer.receive()).type in (
                            aiohttp.WSMsgType.TEXT,
                            aiohttp.WSMsgType.BINARY,
                        ):
                            pass
                    assert viewer.close_code == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
                await news(other, "update")

        asyncio.run(run())


def test_there_is_an_end_to_the_number_of_viewers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web_server, "MOST_VIEWERS", 1)
    with Bus() as bus, serving(bus) as view:

        async def talk(viewer: aiohttp.ClientWebSocketResponse) -> None:
            await news(viewer, "update")
            async with (
                aiohttp.ClientSession() as session,
                session.get(view.url + "live", headers=UPGRADE) as answer,
            ):
                assert answer.status == 503

        converse(view, talk)


def deaf_viewer(view: WebView) -> socket.socket:
    """Return the connection of a viewer that never reads, once it counts as one."""
    port = int(view.url.rstrip("/").rpartition(":")[2])
    head = "".join(f"{name}: {value}\r\n" for name, value in UPGRADE.items())
    deaf = socket.create_connection(("127.0.0.1", port))
    deaf.sendall(f"GET /live HTTP/1.1\r\nHost: 127.0.0.1\r\n{head}\r\n".encode())
    until(lambda: view._broadcaster.viewers)
    return deaf


def test_a_viewer_that_does_not_answer_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web_server, "HEARTBEAT_S", 0.2)
    with Bus() as bus, serving(bus) as view, deaf_viewer(view):
        until(lambda: not view._broadcaster.viewers)


def test_the_end_is_told_to_viewers_even_those_that_do_not_listen() -> None:
    with Bus() as bus:
        view = WebView(view_plan(), bus, Injections())
        with deaf_viewer(view):

            async def talk(viewer: aiohttp.ClientWebSocketResponse) -> None:
                await news(viewer, "update")
                closer = Thread(target=view.close)
                closer.start()
                async with asyncio.timeout(30):
                    while (await viewer.receive()).type != aiohttp.WSMsgType.CLOSE:
                        pass
                assert viewer.close_code == aiohttp.WSCloseCode.GOING_AWAY
                await asyncio.to_thread(closer.join)

            converse(view, talk)
        with pytest.raises(OSError, match="refused"):
            deaf_viewer(view)


def test_ten_viewers_cost_the_pipeline_no_message() -> None:
    content = {
        "sensors": SENSORS[:1],
        "injections": [{"sensor": "radar", "kind": "snr", "level": 0}],
        "duration_s": 1.5,
        "clock": {"speed": 0.5},
        "outputs": {"view": {"port": 0}},
    }
    with Bus() as bus:
        pipeline = Pipeline(plan(check_scene(content, "test")), bus)
        view = WebView(pipeline.plan, bus, pipeline.set_injection)

        async def watch() -> None:
            async with aiohttp.ClientSession() as session:
                viewers = [await session.ws_connect(view.url + "live") for _ in range(10)]
                running = asyncio.create_task(asyncio.to_thread(lambda: list(pipeline.run())))
                request = {"id": 1, "sensor": "radar", "kind": "snr", "level": 80}
                await viewers[0].send_json(request)
                assert (await news(viewers[0], "answer"))["ok"]
                while not running.done():
                    for viewer in viewers:
                        record = await news(viewer, "update")
                assert record["sensors"]["radar"]["injected"] == {"snr": 80}
                await running

        asyncio.run(watch())
        view.close()
        counts = pipeline.summary()["sensors"]["radar"]
        assert counts["estimated"] == counts["received"] > 15
        assert counts["dropped_by_queue"] == 0
        assert view.counts()["viewers"] == 10


def test_a_page_without_a_camera_loads_no_opencv() -> None:
    script = """
import sys
from node.bus.in_process import Bus
from node.bus.web import WebView
from node.plan import plan
from node.scene import check_scene
content = {"sensors": [{"name": "radar", "type": "radar", "source": "world"}],
           "outputs": {"view": {"port": 0}}}
with Bus() as bus:
    WebView(plan(check_scene(content, "test")), bus, print).close()
print(sorted({"cv2", "av", "onnxruntime", "matplotlib"} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stderr


def test_the_scene_says_which_sensors_have_buttons() -> None:
    with Bus() as bus:
        scene = Feed(view_plan(), bus).full(0)["scene"]
    assert NOISE["kind"] in scene["sensors"][1]["kinds"]
    assert scene["sensors"][0]["kinds"] == []
    assert scene["sensors"][0]["source"] == "the simulated world"
