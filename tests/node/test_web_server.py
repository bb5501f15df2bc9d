from __future__ import annotations

import asyncio
import re
import sys
from typing import Any

import pytest

pytest.importorskip("aiohttp", reason="needs the extra 'view'")

import aiohttp

from dbc.errors import InputError, MissingExtra
from node.bus import web_server
from node.bus.in_process import Bus
from node.bus.web import WebView
from tests.node.web_views import (
    UPGRADE,
    Injections,
    news,
    serving,
    view_plan,
)

LEVEL = "/murk/camera/noise_level"
IMAGE = "/murk/camera/image"


def ask(view: WebView, path: str = "", **options: Any) -> tuple[int, str, dict[str, str]]:
    async def run() -> tuple[int, str, dict[str, str]]:
        async with (
            aiohttp.ClientSession() as session,
            session.get(view.url + path, **options) as answer,
        ):
            return answer.status, await answer.text(), dict(answer.headers)

    return asyncio.run(run())


def test_other_sites_get_nothing() -> None:
    with Bus() as bus, serving(bus) as view:
        assert ask(view)[0] == 200
        assert ask(view, headers={"Host": "evil.example"})[0] == 421
        assert ask(view, "live", headers={**UPGRADE, "Origin": "http://evil.example"})[0] == 403
        assert view.counts()["denied"] == 2
        assert view.counts()["viewers"] == 0


def test_what_the_page_needs_is_served_and_nothing_else() -> None:
    with Bus() as bus, serving(bus) as view:
        text = ask(view)[1]
        for path in re.findall(r'(?:href|src)="([a-z_.]+)"', text):
            assert ask(view, path)[0] == 200, path
        for script in re.findall(r'from "\./([a-z_.]+)"', ask(view, "page.js")[1]):
            assert ask(view, script)[2]["Content-Type"].startswith("text/javascript"), script
        headers = ask(view)[2]
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        for path in ("web.py", "../web.py", "%2e%2e/web.py", "page", "live"):
            assert ask(view, path)[0] in (400, 404), path


SECRET = "correct horse"


def test_a_token_is_asked_for_and_then_kept_in_a_cookie() -> None:
    with Bus() as bus, serving(bus, host="127.0.0.1", token=SECRET) as view:
        status, text, _ = ask(view)
        assert status == 401
        assert '<input id="token"' in text
        assert ask(view, "page.js")[0] == ask(view, "live", headers=UPGRADE)[0] == 401
        assert ask(view, "page.css")[0] == 200
        assert ask(view, headers={"Authorization": f"Bearer {SECRET}"})[0] == 200
        assert ask(view, headers={"Authorization": "Bearer wrong"})[0] == 401
        assert ask(view, "?token=wrong")[0] == 401

        async def run() -> None:
            jar = aiohttp.CookieJar(unsafe=True)
            async with aiohttp.ClientSession(cookie_jar=jar) as session:
                async with session.get(view.url, params={"token": SECRET}) as answer:
                    assert answer.status == 200
                    assert str(answer.url) == view.url  # the token is gone from the address
                (cookie,) = jar
                assert cookie["httponly"]
                assert cookie["samesite"] == "Lax"
                async with session.ws_connect(view.url + "live") as viewer:
                    await news(viewer, "update")

        asyncio.run(run())
        assert view.counts()["denied"] == 2


def test_tokens_cannot_be_guessed_in_a_row_nor_requests_made_without_end() -> None:
    with Bus() as bus, serving(bus, token=SECRET) as view:
        answers = [ask(view, "?token=guess")[0] for _ in range(15)]
        assert answers[: int(web_server.GUESSES_BURST)] == [401] * int(web_server.GUESSES_BURST)
        assert answers[-1] == 429
        assert ask(view, "?token=correct+horse")[0] == 429
        assert ask(view, headers={"Authorization": f"Bearer {SECRET}"})[0] == 429

        async def run() -> list[int]:
            async with aiohttp.ClientSession() as session:
                statuses = []
                for _ in range(1500):
                    async with session.get(view.url + "icon.svg") as answer:
                        statuses.append(answer.status)
                return statuses

        assert {200, 429} == set(asyncio.run(run()))
        assert view.counts()["too_many"] > 0


def test_a_port_in_use_is_one_line() -> None:
    with Bus() as bus, serving(bus) as view:
        port = int(view.url.rstrip("/").rpartition(":")[2])
        with pytest.raises(InputError, match=rf"127\.0\.0\.1:{port}: address already in use"):
            WebView(view_plan(port=port), bus, Injections())


def test_an_address_of_another_computer_is_one_line() -> None:
    with Bus() as bus, pytest.raises(InputError, match=r"192\.0\.2\.1:0"):
        WebView(view_plan(host="192.0.2.1", token=SECRET), bus, Injections())


def test_without_aiohttp_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("node.bus.web_broadcast", "node.bus.web_server"):
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    with Bus() as bus, pytest.raises(MissingExtra, match=r"pip install 'murk\[view\]'"):
        WebView(view_plan(), bus, Injections())
