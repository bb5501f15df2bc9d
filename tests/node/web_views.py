"""What the tests of the page share: a view on a bus, and viewers of it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic, sleep
from typing import Any

import aiohttp
import numpy as np

from dbc.errors import SceneError
from drivers.frame import Frame
from models.estimate.level import LEVELS, NoiseLevel
from node.bus.in_process import Bus
from node.bus.web import WebView
from node.plan import Plan, plan
from node.scene import check_scene

SENSORS = [
    {"name": "radar", "type": "radar", "source": "world"},
    {"name": "camera", "type": "camera", "source": "world"},
]
NOISE = {"sensor": "camera", "kind": "noise", "level": 0}
PATIENCE_S = 30.0

UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}
"""Headers that ask for a web socket (RFC 6455)."""


def view_plan(**settings: Any) -> Plan:
    outputs = {"view": {"port": 0, **settings}}
    content = {"sensors": SENSORS, "injections": [NOISE], "outputs": outputs}
    return plan(check_scene(content, "test"))


class Injections:
    """Stands in for the pipeline: keeps what was asked, refuses what is not noise."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, str, float | None]] = []

    def __call__(self, sensor: str, kind: str, level: float | None) -> None:
        if (sensor, kind) != ("camera", "noise"):
            raise SceneError(sensor, f"has no kind '{kind}'", "a camera has noise")
        self.asked.append((sensor, kind, level))


@contextmanager
def serving(bus: Bus, injections: Injections | None = None, **settings: Any) -> Iterator[WebView]:
    view = WebView(view_plan(**settings), bus, injections or Injections())
    try:
        yield view
    finally:
        view.close()


def level_of(sensor: str, level: float, sequence: int = 0, **changes: Any) -> NoiseLevel:
    values = {
        "sensor": sensor,
        "stamp_ns": 1,
        "level": level,
        "std": 2.0,
        "probabilities": np.eye(len(LEVELS))[0],
        "kind": "noise",
        "kind_probabilities": {"clean": 0.1, "noise": 0.9},
        "raw": level,
        "injected": {"noise": 60.0},
        "latency_ns": 3_000_000,
        "sequence": sequence,
        "dropped": 4,
    }
    return NoiseLevel(**(values | changes))


def frame(value: int = 90, sequence: int = 0) -> Frame:
    image = np.full((540, 960, 3), value, np.uint8)
    return Frame(image, "camera", sequence, 1, "simulated")


async def news(socket: aiohttp.ClientWebSocketResponse, kind: str) -> dict[str, Any]:
    """Return the next message of a type; thumbnails and others are passed over."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            message = await socket.receive()
            assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY), message
            if message.type == aiohttp.WSMsgType.TEXT:
                record: dict[str, Any] = json.loads(message.data)
                if record["type"] == kind:
                    return record


async def thumbnail(socket: aiohttp.ClientWebSocketResponse) -> bytes:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            message = await socket.receive()
            if message.type == aiohttp.WSMsgType.BINARY:
                return bytes(message.data)


def until(condition: Any) -> None:
    """Wait for what another thread does."""
    end_s = monotonic() + PATIENCE_S
    while not condition():
        assert monotonic() < end_s
        sleep(0.01)
