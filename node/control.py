"""Live control of a running gateway or node, through a local socket that only its owner can open.

Each gateway listens on one socket, named after its sensor, and each node (``murk run``) on one
named after its scene, in a folder of their user. A request is
one line of JSON, ``{"kind": "snr", "level": 60}``, and so is the answer: ``{"ok": true}``, or
``{"ok": false, "where": ..., "what": ..., "remedy": ...}``.
"""

from __future__ import annotations

import json
import os
import socket
import socketserver
import stat
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from types import TracebackType
from typing import Any, Literal, Self, cast

from dbc.errors import InputError, SceneError

Role = Literal["gateway", "node"]
ANSWER_TIMEOUT_S = 5.0
_NAMED_BY: dict[Role, str] = {"gateway": "--sensor", "node": "the scene's name"}
_LONGEST_REQUEST = 1024
_CREDENTIALS = struct.Struct("3i")
"""``struct ucred``: process, user, group."""

SetLevel = Callable[[str, float], None]


class ControlError(InputError):
    """A control socket cannot be made, or nothing of that name is running."""


class ControlServer:
    """Listens for the commands to one gateway or node; a context manager, or ``close`` it.

    Parameters
    ----------
    name:
        The gateway's sensor, or the node's scene.
    set_level:
        Is called with kind and level (%), or with a parameter of the node and its value; what it
        raises of ``InputError`` goes to the caller.
    role:
        Who listens.

    Raises
    ------
    ControlError
        If one of this name is running already, or the socket cannot be made.
    """

    def __init__(self, name: str, set_level: SetLevel, role: Role = "gateway") -> None:
        self._path = _socket_path(name, role)
        if _answers(self._path):
            remedy = f"end it, or name this one otherwise ({_NAMED_BY[role]})"
            raise ControlError(name, f"has a running {role} already", remedy)
        self._path.unlink(missing_ok=True)
        try:
            self._server = _Server(self._path, set_level)
        except OSError as error:
            raise ControlError(self._path, f"no control socket: {error.strerror}") from None
        self._thread = Thread(target=self._server.serve_forever, args=(0.05,))
        self._thread.name = f"murk-control-{name}"
        self._thread.daemon = True
        self._thread.start()

    def close(self) -> None:
        """Stop listening and remove the socket."""
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()
        self._path.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def set_level(name: str, kind: str, level: float, role: Role = "gateway") -> None:
    """Set a level (%) in a running gateway or node, in whatever process of this user.

    Parameters
    ----------
    name:
        The gateway's sensor, or the node's scene.
    kind, level:
        An injection and its level, or a fault and its rate, in %; of a node a parameter (see
        ``node.parameters``) and its value.
    role:
        Who shall be told.

    Raises
    ------
    ControlError
        If none of this name runs.
    SceneError
        If there is no such kind or parameter, or the value is impossible.
    """
    try:
        path = _socket_path(name, role)
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(ANSWER_TIMEOUT_S)
            connection.connect(str(path))
            connection.sendall(json.dumps({"kind": kind, "level": level}).encode() + b"\n")
            with connection.makefile("rb") as answers:
                answer = json.loads(answers.readline())
    except TimeoutError:
        raise ControlError(name, f"its {role} does not answer") from None
    except (OSError, ValueError):
        others = ", ".join(running(role))
        remedy = f"running: {others}" if others else "none is running"
        raise ControlError(name, f"has no running {role}", remedy) from None
    if not answer["ok"]:
        raise SceneError(answer["where"], answer["what"], answer["remedy"])


def running(role: Role = "gateway") -> list[str]:
    """Return the names of this user's running gateways or nodes."""
    return sorted(path.stem for path in _folder().glob(f"*.{role}") if _answers(path))


class _Server(socketserver.ThreadingUnixStreamServer):
    """Serves each connection in a thread of its own, so that a silent one blocks nobody."""

    daemon_threads = True

    def __init__(self, path: Path, set_level: SetLevel) -> None:
        self.set_level = set_level
        super().__init__(str(path), _Connection)
        path.chmod(0o600)

    def verify_request(self, request: Any, client_address: Any) -> bool:
        return _user_of(cast(socket.socket, request)) in (os.getuid(), 0)


class _Connection(socketserver.StreamRequestHandler):
    """One client, that sends a command a line."""

    timeout = ANSWER_TIMEOUT_S

    def handle(self) -> None:
        set_level = cast(_Server, self.server).set_level
        try:
            while line := self.rfile.readline(_LONGEST_REQUEST):
                self.wfile.write(json.dumps(_answer(line, set_level)).encode() + b"\n")
        except OSError:
            return  # the client has gone or says nothing


def _answer(line: bytes, set_level: SetLevel) -> dict[str, Any]:
    try:
        request = json.loads(line)
        kind, level = str(request["kind"]), float(request["level"])
    except (ValueError, KeyError, TypeError):
        expected = 'expected {"kind": KIND, "level": LEVEL}'
        return {"ok": False, "where": "control", "what": "is no command", "remedy": expected}
    try:
        set_level(kind, level)
    except InputError as error:
        return {"ok": False, "where": error.where, "what": error.what, "remedy": error.remedy}
    return {"ok": True}


def _user_of(connection: socket.socket) -> int:
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    return int(_CREDENTIALS.unpack(credentials)[1])


def _answers(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(ANSWER_TIMEOUT_S)
        try:
            connection.connect(str(path))
        except OSError:
            return False
    return True


def _socket_path(name: str, role: Role) -> Path:
    return _folder() / f"{name.replace('/', '_')}.{role}"


def _folder() -> Path:
    """Return this user's folder for control sockets, made where it is missing.

    Raises
    ------
    ControlError
        If it cannot be made, or somebody else could have put something there.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    name = "murk" if runtime else f"murk-{os.getuid()}"
    folder = Path(runtime or tempfile.gettempdir()) / name
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        state = folder.lstat()
    except OSError as error:
        raise ControlError(folder, f"cannot be made: {error.strerror}") from None
    if state.st_uid != os.getuid() or stat.S_IMODE(state.st_mode) != 0o700:
        raise ControlError(folder, "is not a folder of yours alone", "remove it or chmod it 700")
    return folder
