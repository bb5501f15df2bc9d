from __future__ import annotations

import re

import cv2
import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="needs the extra 'view'")

from dbc.errors import InputError
from node.bus.web_access import Access
from node.bus.web_limits import RateLimit, RateLimits
from node.bus.web_requests import parse_request
from node.bus.web_server import HEADERS, TYPES, _folder
from node.bus.web_thumbnail import WIDTH, encode_thumbnail
from node.scene import ViewSettings

OPEN = Access(ViewSettings(), 8408)
CLOSED = Access(ViewSettings(host="0.0.0.0", token="a long secret"), 8408)


@pytest.mark.parametrize(
    "host", ["127.0.0.1:8408", "localhost:8408", "[::1]:8408", "192.168.1.7:8408", "localhost"]
)
def test_addresses_and_names_of_this_computer_are_its_hosts(host: str) -> None:
    assert OPEN.allows_host(host)


@pytest.mark.parametrize("host", ["evil.example:8408", "127.0.0.1.evil.example", "", "[::1", "[x]"])
def test_a_name_that_somebody_points_here_is_none_of_its_hosts(host: str) -> None:
    assert not OPEN.allows_host(host)


@pytest.mark.parametrize(
    ("origin", "allowed"),
    [
        (None, True),
        ("http://localhost:8408", True),
        ("https://localhost:8408", True),
        ("http://localhost:9000", False),
        ("http://evil.example", False),
        ("null", False),
    ],
)
def test_only_the_page_itself_is_its_origin(origin: str | None, allowed: bool) -> None:
    assert OPEN.allows_origin(origin, "localhost:8408") is allowed


def test_a_token_or_its_cookie_opens() -> None:
    assert OPEN.allows_cookie("")
    assert CLOSED.allows_token("a long secret")
    assert CLOSED.allows_cookie(CLOSED.cookie)
    for wrong in ("", "a long", "a long secret ", "\udcff", "ü", CLOSED.cookie[:-1]):
        assert not CLOSED.allows_token(wrong)
        assert not CLOSED.allows_cookie(wrong)
    assert "secret" not in CLOSED.cookie
    assert CLOSED.cookie == Access(ViewSettings(token="a long secret"), 1).cookie
    assert CLOSED.cookie != Access(ViewSettings(token="another secret"), 1).cookie


def test_a_burst_passes_and_then_the_rate() -> None:
    limit = RateLimit(rate_hz=1e-6, burst=3)
    assert [limit.allows() for _ in range(5)] == [True, True, True, False, False]
    quick = RateLimit(rate_hz=1e12, burst=1)
    assert all(quick.allows() for _ in range(5))


def test_one_address_does_not_use_up_the_limit_of_another() -> None:
    limits = RateLimits(rate_hz=1e-6, burst=1)
    assert limits.allows("a")
    assert not limits.allows("a")
    assert limits.allows("b")
    for other in range(1000):
        limits.allows(str(other))
    assert limits.allows("a")  # forgotten: the table stays small


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("", "request"),
        ("{", "request"),
        ("[]", "request"),
        ("[" * 100_000, "request"),
        ('{"id": 1, "sensor": "camera", "kind": "noise"}', "level"),
        ('{"id": 1, "sensor": "camera", "kind": "noise", "level": 101}', "level"),
        ('{"id": 1, "sensor": "camera", "kind": "noise", "level": -1}', "level"),
        ('{"id": 1, "sensor": "camera", "kind": "noise", "level": NaN}', "level"),
        ('{"id": 1, "sensor": "camera", "kind": "noise", "level": "60"}', "level"),
        ('{"id": 1, "sensor": "camera", "kind": "noise", "level": true}', "level"),
        ('{"id": 1, "sensor": 3, "kind": "noise", "level": 1}', "sensor"),
        ('{"id": "x", "sensor": "camera", "kind": "noise", "level": 1}', "id"),
        ('{"id": 1, "sensor": "camera", "kind": "noise", "level": 1, "more": 1}', "more"),
    ],
)
def test_a_malformed_request_names_its_field_in_one_line(text: str, where: str) -> None:
    with pytest.raises(InputError) as raised:
        parse_request(text)
    assert raised.value.where == where
    assert "\n" not in str(raised.value)


def test_a_request_is_read() -> None:
    request = parse_request('{"id": 7, "sensor": "camera", "kind": "noise", "level": 60}')
    assert (request.id, request.sensor, request.kind, request.level) == (7, "camera", "noise", 60)
    assert parse_request('{"id":1,"sensor":"a","kind":"b","level":null}').level is None


def test_a_thumbnail_is_small_and_keeps_the_noise() -> None:
    noise = np.random.default_rng(0).normal(120, 40, (900, 1600, 1)).clip(0, 255)
    image = np.repeat(noise, 3, axis=2).astype(np.uint8)
    small = cv2.imdecode(np.frombuffer(encode_thumbnail(image), np.uint8), cv2.IMREAD_COLOR)
    assert small is not None
    assert small.shape[1] <= WIDTH
    assert small.shape[0] / small.shape[1] == pytest.approx(9 / 16, abs=0.01)
    assert small.std() > 0.8 * image.std()


def test_an_image_that_is_small_already_stays_as_large_as_it_is() -> None:
    image = np.zeros((30, 40, 3), np.uint8)
    small = cv2.imdecode(np.frombuffer(encode_thumbnail(image), np.uint8), cv2.IMREAD_COLOR)
    assert small is not None
    assert small.shape == image.shape


def test_the_page_asks_nothing_of_any_other_computer() -> None:
    files = sorted(_folder().iterdir())
    assert {path.suffix for path in files} <= set(TYPES)
    for path in files:
        text = path.read_text(encoding="utf-8").replace("http://www.w3.org/2000/svg", "")
        assert not re.search(r"https?://|@import|url\(", text.replace("ws://", "")), path.name
    assert "default-src 'none'" in HEADERS["Content-Security-Policy"]


def luminance(colour: str) -> float:
    """Return the relative luminance of #rrggbb (WCAG 2.2)."""
    channels = (int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5))
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
@pytest.mark.parametrize("ground", ["card", "raised"])
@pytest.mark.parametrize("ink", ["text", "muted", "injected", "good", "fair", "poor"])
def test_every_text_is_read_in_sunlight_and_at_night(ink: str, ground: str, theme: int) -> None:
    text = (_folder() / "page.css").read_text(encoding="utf-8")
    pairs = dict(re.findall(r"--([a-z-]+): light-dark\((#\w{6}, #\w{6})\)", text))
    dark, light = sorted(luminance(pairs[name].split(", ")[theme]) for name in (ink, ground))
    assert (light + 0.05) / (dark + 0.05) >= (4.5 if ground == "card" else 4.0)
