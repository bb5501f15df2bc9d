"""Snapshots for all viewers: made once, sent to each as fast as it takes them."""

from __future__ import annotations

import asyncio
import json
import logging
from collections import Counter
from typing import Any

from aiohttp import WSCloseCode, web

from node.bus.in_process import Bus
from node.bus.web_feed import Feed

log = logging.getLogger("murk.view")

PERIOD_S = 0.1
THUMBNAIL_TICKS = 2
"""Thumbnails go with every second snapshot."""


class Broadcaster:
    """Makes a snapshot every ``PERIOD_S`` while somebody watches, and thumbnails of new frames.

    A viewer that is still busy with one misses the next ones, and gets everything with the newest;
    so no viewer has more than one waiting, and none holds up another.

    Attributes
    ----------
    viewers:
        Who watches now.
    counts:
        ``snapshots`` and ``thumbnails`` made, ``skipped`` by viewers that were busy, and
        ``failures`` to make one.
    """

    def __init__(self, feed: Feed, bus: Bus) -> None:
        self.viewers: set[web.WebSocketResponse] = set()
        self.counts: Counter[str] = Counter()
        self._feed = feed
        self._bus = bus
        self._tick = 0
        self._update = ""
        self._images: dict[int, Any] = {}
        self._thumbnails: dict[int, bytes] = {}
        self._new_thumbnails: dict[int, bytes] = {}
        self._since = (0, 0)
        self._made = asyncio.Event()
        self._watched = asyncio.Event()

    async def run(self) -> None:
        """Make snapshots until cancelled."""
        while True:
            if not self.viewers:
                self._watched.clear()
                await self._watched.wait()
            try:
                self._make()
            except Exception:
                self._fail()
            made, self._made = self._made, asyncio.Event()
            made.set()
            await asyncio.sleep(PERIOD_S)

    async def follow(self, viewer: web.WebSocketResponse) -> None:
        """Send a viewer snapshots until it is closed or this is cancelled."""
        self.viewers.add(viewer)
        self._watched.set()
        try:
            await self._send_all(viewer)
        except ConnectionError:
            pass  # it has gone
        except Exception:
            self._fail()
            await viewer.close(code=WSCloseCode.INTERNAL_ERROR)
        finally:
            self.viewers.discard(viewer)

    def _fail(self) -> None:
        self.counts["failures"] += 1
        if self.counts["failures"] == 1:
            log.exception("a snapshot for the page failed; further failures are counted")

    async def _send_all(self, viewer: web.WebSocketResponse) -> None:
        seen: int | None = None
        while not viewer.closed:
            tick = self._tick
            if seen is not None and tick == seen + 1:
                text, thumbnails = self._update, self._new_thumbnails
            else:
                self.counts["skipped"] += tick - seen - 1 if seen is not None else 0
                text, thumbnails = _encode(self._feed.full(tick)), dict(self._thumbnails)
            await viewer.send_str(text)
            for thumbnail in thumbnails.values():
                await viewer.send_bytes(thumbnail)
            seen = tick
            while self._tick == seen:
                await self._made.wait()

    def _make(self) -> None:
        self._tick += 1
        self.counts["snapshots"] += 1
        since_ms, since_event = self._since
        self._since = (self._feed.now_ms(), self._feed.last_event)
        self._update = _encode(self._feed.update(self._tick, since_ms, since_event))
        self._new_thumbnails = {}
        if self._tick % THUMBNAIL_TICKS == 0:
            self._new_thumbnails = dict(self._make_thumbnails())
            self._thumbnails |= self._new_thumbnails

    def _make_thumbnails(self) -> Any:
        """Yield index and thumbnail of each camera that has a new frame.

        The index, one byte, also begins the thumbnail.
        """
        for index, feed in enumerate(self._feed.sensors):
            if feed.sensor.type != "camera":
                continue
            frame = self._bus.latest(f"/murk/{feed.sensor.name}/image")
            if frame is None or frame is self._images.get(index):
                continue
            from node.bus.web_thumbnail import encode_thumbnail

            self._images[index] = frame
            self.counts["thumbnails"] += 1
            yield index, bytes([index]) + encode_thumbnail(frame.image)


def _encode(record: dict[str, Any]) -> str:
    return json.dumps(record, allow_nan=False, default=float, separators=(",", ":"))
