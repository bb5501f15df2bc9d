"""The page's server: files, a WebSocket of snapshots and injection requests, and who may in."""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from dbc.errors import InputError
from node.bus.web_access import Access
from node.bus.web_broadcast import Broadcaster
from node.bus.web_limits import RateLimit, RateLimits
from node.bus.web_requests import InjectionRequest, answer, parse_request, refusal
from node.outputs import SetInjection

MOST_VIEWERS = 64
LONGEST_MESSAGE = 4096
HEARTBEAT_S = 5.0
MESSAGES_HZ, MESSAGES_BURST = 20.0, 40.0
"""What a viewer may send; the page sends ten a second while a slider moves."""
REQUESTS_HZ, REQUESTS_BURST = 50.0, 300.0
"""What an address may ask for; a page that opens asks for a dozen files."""
GUESSES_HZ, GUESSES_BURST = 0.5, 10.0
"""Wrong tokens that an address may show."""

TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
}
WITHOUT_TOKEN = ("/page.css", "/icon.svg")
HEADERS = {
    "Cache-Control": "no-cache",
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
    ),
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""Nothing from elsewhere, and inside nobody's frame; a token in an address goes nowhere."""


class PageServer:
    """Answers requests; all of it runs in one event loop.

    Parameters
    ----------
    access:
        Who may in.
    broadcaster:
        What viewers are sent.
    set_injection:
        What they may ask for.
    tell:
        Is called with a line for a person where something is refused.

    Attributes
    ----------
    counts:
        ``viewers`` so far, ``injections`` done, requests ``malformed``, ``floods`` closed, and
        requests ``denied`` by host, origin or token or ``too_many`` of an address.
    """

    def __init__(
        self,
        access: Access,
        broadcaster: Broadcaster,
        set_injection: SetInjection,
        tell: Callable[[str], None],
    ) -> None:
        self.counts: Counter[str] = Counter()
        self._access = access
        self._broadcaster = broadcaster
        self._set_injection = set_injection
        self._tell = tell
        self._requests = RateLimits(REQUESTS_HZ, REQUESTS_BURST)
        self._guesses = RateLimits(GUESSES_HZ, GUESSES_BURST)
        self._files = {f"/{path.name}": path for path in _folder().iterdir()}

    def application(self) -> web.Application:
        """Return what an aiohttp runner serves."""
        application = web.Application()
        application.router.add_get("/{path:.*}", self._respond)
        return application

    async def _respond(self, request: web.Request) -> web.StreamResponse:
        """Answer a request that may in; every answer carries ``HEADERS``."""
        try:
            self._check(request)
            if request.path == "/live":
                return await self._live(request)
            path = self._files.get("/index.html" if request.path == "/" else request.path)
            if path is None:
                raise web.HTTPNotFound(text="there is no such page\n")
            text = path.read_text(encoding="utf-8")
        except web.HTTPException as error:
            error.headers.update(HEADERS)
            raise
        return web.Response(text=text, content_type=TYPES[path.suffix], headers=HEADERS)

    def _check(self, request: web.Request) -> None:
        """Raise the HTTP error of a request that may not in."""
        address, host = request.remote or "", request.headers.get("Host", "")
        if not self._requests.allows(address):
            self._deny("too_many", f"{address} asks too often")
            raise web.HTTPTooManyRequests(text="too many requests\n")
        if not self._access.allows_host(host):
            self._deny("denied", f"{address} asked for the page of {host[:80]!r}")
            raise web.HTTPMisdirectedRequest(text="this is not the host that you asked for\n")
        if not self._access.allows_origin(request.headers.get("Origin"), host):
            self._deny("denied", f"a page of {request.headers['Origin'][:80]!r} asked for this one")
            raise web.HTTPForbidden(text="not from another page\n")
        if request.path in WITHOUT_TOKEN:
            return
        if "token" in request.query:
            self._check_token(request.query["token"], address)
            found = web.HTTPSeeOther("/")
            found.set_cookie(
                self._access.cookie_name, self._access.cookie, httponly=True, samesite="Lax"
            )
            raise found
        if self._access.allows_cookie(request.cookies.get(self._access.cookie_name, "")):
            return
        scheme, _, token = request.headers.get("Authorization", "").partition(" ")
        if scheme.lower() != "bearer":
            raise self._ask_for_token()
        self._check_token(token.strip(), address)

    def _check_token(self, token: str, address: str) -> None:
        """Raise the HTTP error of a wrong token, or of too many."""
        if self._guesses.exhausted(address):
            self._deny("too_many", f"{address} shows too many tokens")
            raise web.HTTPTooManyRequests(text="too many tokens; wait a little\n")
        if self._access.allows_token(token):
            return
        self._guesses.allows(address)
        self._deny("denied", f"{address} showed a wrong token")
        raise self._ask_for_token()

    def _ask_for_token(self) -> web.HTTPUnauthorized:
        text = self._files["/token.html"].read_text(encoding="utf-8")
        return web.HTTPUnauthorized(text=text, content_type="text/html")

    def _deny(self, count: str, detail: str) -> None:
        self.counts[count] += 1
        self._tell(detail)

    async def _live(self, request: web.Request) -> web.StreamResponse:
        """Serve one viewer until it goes."""
        if len(self._broadcaster.viewers) >= MOST_VIEWERS:
            self._deny("too_many", f"{MOST_VIEWERS} viewers are there already")
            raise web.HTTPServiceUnavailable(text="too many viewers\n")
        viewer = web.WebSocketResponse(
            compress=False, heartbeat=HEARTBEAT_S, max_msg_size=LONGEST_MESSAGE, timeout=1.0
        )
        await viewer.prepare(request)
        self.counts["viewers"] += 1
        limit = RateLimit(MESSAGES_HZ, MESSAGES_BURST)
        sending = asyncio.create_task(self._broadcaster.follow(viewer))
        try:
            async for message in viewer:
                if not limit.allows():
                    await self._end_flood(viewer, request)
                    break
                with suppress(ConnectionError):
                    await viewer.send_str(json.dumps(self._answer(message)))
        finally:
            sending.cancel()
        return viewer

    async def _end_flood(self, viewer: web.WebSocketResponse, request: web.Request) -> None:
        """Close a viewer that sends too much; what it still sends is not read."""
        self._deny("floods", f"{request.remote} sends over {MESSAGES_HZ:.0f} messages/s: closed")
        if request.transport is not None:
            asyncio.get_running_loop().call_later(0.1, request.transport.abort)
        await viewer.close(code=WSCloseCode.POLICY_VIOLATION, message=b"too many messages")

    def _answer(self, message: WSMessage) -> dict[str, Any]:
        """Do what a viewer asks, or say why not."""
        request: InjectionRequest | None = None
        try:
            request = parse_request(message.data if message.type == WSMsgType.TEXT else "")
            reply = answer(request, self._set_injection)
        except InputError as error:
            self._deny("malformed", f"a viewer's request was refused: {error}")
            return refusal(error, request)
        self.counts["injections"] += 1
        return reply


def _folder() -> Path:
    return Path(__file__).with_name("page")
