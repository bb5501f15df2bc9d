"""The page: a live view of the run in a browser, served by a thread of its own."""

from __future__ import annotations

import asyncio
import socket
import sys
from contextlib import suppress
from threading import Thread
from time import time_ns
from typing import TYPE_CHECKING, Any

from dbc.errors import InputError, MissingExtra
from node.bus.in_process import Bus
from node.bus.web_access import Access
from node.bus.web_feed import Feed
from node.bus.web_limits import RateLimit
from node.events import EVENT_TOPIC, NodeEvent
from node.outputs import SetInjection
from node.plan import Plan
from node.scene import ViewSettings

if TYPE_CHECKING:
    from aiohttp import web

    from node.bus.web_broadcast import Broadcaster
    from node.bus.web_server import PageServer

GOODBYE_S = 0.2
"""How long a viewer may take to hear that the node ends."""
BACKLOG = 128


class WebView:
    """Serves the page from when it is built until ``close``.

    Parameters
    ----------
    plan:
        The run; its scene says where to serve, and which sensors take injections.
    bus:
        What is shown; trouble with viewers is published on it.
    set_injection:
        What viewers may ask for.

    Attributes
    ----------
    url:
        Where the page is.

    Raises
    ------
    MissingExtra
        If aiohttp is not installed.
    InputError
        If the port is in use, or the address not this computer's.
    """

    def __init__(self, plan: Plan, bus: Bus, set_injection: SetInjection) -> None:
        try:
            from node.bus.web_broadcast import Broadcaster
            from node.bus.web_server import PageServer
        except ModuleNotFoundError as error:
            raise MissingExtra("view", "--view") from error
        settings = plan.scene.outputs.view or ViewSettings()
        self._socket = _listen(settings)
        port = self._socket.getsockname()[1]
        host = f"[{settings.host}]" if ":" in settings.host else settings.host
        self.url = f"http://{host}:{port}/"
        self._bus = bus
        self._limit = RateLimit(rate_hz=1.0, burst=5.0)
        self._untold = 0
        self._feed = Feed(plan, bus)
        self._loop = asyncio.new_event_loop()
        self._ending = asyncio.Event()
        self._broadcaster: Broadcaster = Broadcaster(self._feed, bus)
        self._server: PageServer = PageServer(
            Access(settings, port), self._broadcaster, set_injection, self._tell
        )
        self._runner = self._loop.run_until_complete(self._open())
        self._thread = Thread(target=self._run, name="murk-view", daemon=True)
        self._thread.start()
        sys.stderr.write(f"murk: page at {self.url}\n")

    @property
    def thread_id(self) -> int:
        """Identifier of the server's thread, for measuring what it costs."""
        return self._thread.ident or 0

    def counts(self) -> dict[str, Any]:
        """Return what was made, sent and refused."""
        return {
            "url": self.url,
            **{name: self._broadcaster.counts[name] for name in _BROADCAST},
            **{name: self._server.counts[name] for name in _SERVED},
            "dropped": self._feed.dropped,
        }

    def close(self) -> None:
        """Say goodbye to the viewers and end."""
        self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join()
        self._feed.close()

    async def _open(self) -> web.AppRunner:
        from aiohttp import web

        runner = web.AppRunner(
            self._server.application(), access_log=None, shutdown_timeout=GOODBYE_S
        )
        await runner.setup()
        await web.SockSite(runner, self._socket, backlog=BACKLOG).start()
        return runner

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve())

    async def _serve(self) -> None:
        broadcast = asyncio.create_task(self._broadcaster.run())
        await self._ending.wait()
        broadcast.cancel()
        goodbyes = [viewer.close(code=1001) for viewer in self._broadcaster.viewers]
        with suppress(TimeoutError):
            await asyncio.wait_for(asyncio.gather(*goodbyes, return_exceptions=True), GOODBYE_S)
        await self._runner.cleanup()

    def _tell(self, detail: str) -> None:
        """Publish what went wrong with a viewer; a flood of it becomes a number."""
        if not self._limit.allows():
            self._untold += 1
            return
        more = f" (and {self._untold} more like it)" if self._untold else ""
        self._untold = 0
        self._bus.publish(EVENT_TOPIC, NodeEvent("view", time_ns(), detail + more))


_BROADCAST = ("snapshots", "thumbnails", "skipped", "failures")
_SERVED = ("viewers", "injections", "malformed", "floods", "denied", "too_many")


def _listen(settings: ViewSettings) -> socket.socket:
    """Return a socket that listens where the scene says.

    Raises
    ------
    InputError
        If it cannot.
    """
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    place = f"the page's address {settings.host}:{settings.port}"
    try:
        return socket.create_server((settings.host, settings.port), family=family)
    except OSError as error:
        what = error.strerror or "cannot be opened"
        raise InputError(place, what.lower(), "give another --host or --port") from None
