"""Who may see the page: the host it is asked by, where a request comes from, and the token."""

from __future__ import annotations

import hmac
import socket
from contextlib import suppress
from hashlib import sha256
from ipaddress import ip_address
from urllib.parse import urlsplit

from node.scene import ViewSettings


class Access:
    """Decides by a request's headers.

    A page of somebody else's that a viewer has open must neither read nor inject: not by a name
    of its own that it lets point here (DNS rebinding: ``allows_host``), and not by a WebSocket,
    which browsers open across sites (``allows_origin``).

    Parameters
    ----------
    settings:
        Host and token of the scene.
    port:
        The port it is served at; cookies are shared by all ports of a host.
    """

    def __init__(self, settings: ViewSettings, port: int) -> None:
        self.cookie_name = f"murk-{port}"
        self._token = settings.token
        name = socket.gethostname().lower()
        self._names = {"localhost", settings.host.lower(), name, f"{name}.local"}

    def allows_host(self, host: str) -> bool:
        """Tell whether a ``Host`` header is an address, or a name of this computer."""
        name = ""
        with suppress(ValueError):
            name = urlsplit(f"//{host}").hostname or ""
            ip_address(name)
            return True
        return name in self._names

    def allows_origin(self, origin: str | None, host: str) -> bool:
        """Tell whether an ``Origin`` header is the page itself; no browser leaves it out."""
        return origin is None or origin in (f"http://{host}", f"https://{host}")

    def allows_token(self, token: str) -> bool:
        """Compare with the token, in a time that does not depend on where they differ."""
        return self._token is None or _equal(token, self._token)

    def allows_cookie(self, cookie: str) -> bool:
        """Tell whether a cookie shows that the token was known, or none is asked for."""
        return self._token is None or _equal(cookie, self.cookie)

    @property
    def cookie(self) -> str:
        """What the cookie holds: follows from the token, so that it outlives the node."""
        return hmac.new((self._token or "").encode(), b"murk page", sha256).hexdigest()


def _equal(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode("utf-8", "replace"), other.encode())
