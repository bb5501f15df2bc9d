"""Live control of a running gateway, through a local socket that only its owner can open.

Each gateway listens on one socket, named after its sensor, in a folder of its user. A request is
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
from typing import Any, Self, cast

from dbc.errors import InputError, SceneError

SUFFIX = ".gateway"
ANSWER_TIMEOUT_S = 5.0
_LONGEST_REQUEST = 1024
_CREDENTIALS = struct.Struct("3i")
"""``struct ucred``: process, user, group."""

SetLevel = Callable[[str, float], None]


class ControlError(InputError):
    """A control socket cannot be made, or there is no gateway for the sensor."""


class ControlServer:
    """Listens for the commands to one gateway; use it as a context manager, or ``close`` it.

    Parameters
    ----------
    sensor:
        The gateway's sensor.
    set_level:
        Is called with kind and level (%); what it raises of ``InputError`` goes to the caller.

    Raises
    ------
    ControlError
        If a gateway for this sensor is running already, or the socket cannot be made.
    """

    def __init__(self, sensor: str, set_level: SetLevel) -> None:
        self._path = _socket_path(sensor)
        if _answers(self._path):
            remedy = "end it, or name this one's sensor otherwise with --sensor"
            raise ControlError(sensor, "has a running gateway already", remedy)
        self._path.unlink(missing_ok=True)
        try:
            self._server = _Server(self._path, set_level)
        except OSError as error:
            raise ControlError(self._path, f"no control socket: {error.strerror}") from None
        name = f"murk-control-{sensor}"
        self._thread = Thread(target=self._server.serve_forever, args=(0.05,), name=name)
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


def set_level(sensor: str, kind: str, level: float) -> None:
    """Set a level (%) in the gateway that runs for a sensor, in whatever process of this user.

    Parameters
    ----------
    sensor:
        Name of the gateway's sensor.
    kind, level:
        An injection and its level, or a fault and its rate, in %.

    Raises
    ------
    ControlError
        If no gateway runs for the sensor.
    SceneError
        If the sensor has no such kind, or the level is outside 0–100 %.
    """
    try:
        path = _socket_path(sensor)
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(ANSWER_TIMEOUT_S)
            connection.connect(str(path))
            connection.sendall(json.dumps({"kind": kind, "level": level}).encode() + b"\n")
            with connection.makefile("rb") as answers:
                answer = json.loads(answers.readline())
    except TimeoutError:
        raise ControlError(sensor, "its gateway does not answer") from None
    except (OSError, ValueError):
        running = ", ".join(running_gateways())
        remedy = f"running: {running}" if running else "none is running"
        raise ControlError(sensor, "has no running gateway", remedy) from None
    if not answer["ok"]:
        raise SceneError(answer["where"], answer["what"], answer["remedy"])


def running_gateways() -> list[str]:
    """Return the sensors for which a gateway of this user runs."""
    return sorted(path.stem for path in _folder().glob(f"*{SUFFIX}") if _answers(path))


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


def _socket_path(sensor: str) -> Path:
    return _folder() / f"{sensor}{SUFFIX}"


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
