from __future__ import annotations

import json
import os
import socket
import stat
from pathlib import Path

import pytest

from dbc.errors import SceneError
from node.control import ControlError, ControlServer, running, set_level


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


class Levels:
    def __init__(self) -> None:
        self.set: list[tuple[str, float]] = []

    def set_level(self, kind: str, level: float) -> None:
        if kind == "wrong":
            raise SceneError("radar", "has no kind 'wrong'", "a radar has snr")
        self.set.append((kind, level))


def ask(path: Path, *lines: bytes) -> list[dict[str, object]]:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(str(path))
        connection.sendall(b"".join(lines))
        connection.shutdown(socket.SHUT_WR)
        with connection.makefile("rb") as answers:
            return [json.loads(line) for line in answers]


def test_a_level_reaches_the_gateway() -> None:
    levels = Levels()
    with ControlServer("radar", levels.set_level):
        assert running() == ["radar"]
        set_level("radar", "snr", 60)
        set_level("radar", "drop", 5)
    assert levels.set == [("snr", 60), ("drop", 5)]
    assert running() == []


def test_the_gateways_refusal_is_raised_by_the_call() -> None:
    with (
        ControlServer("radar", Levels().set_level),
        pytest.raises(SceneError, match="radar: has no kind 'wrong'; a radar has snr"),
    ):
        set_level("radar", "wrong", 60)


def test_a_sensor_that_is_not_there_is_told_with_those_that_are() -> None:
    with pytest.raises(ControlError, match="radar: has no running gateway; none is running"):
        set_level("radar", "snr", 60)
    with (
        ControlServer("front", Levels().set_level),
        pytest.raises(ControlError, match="radar: has no running gateway; running: front"),
    ):
        set_level("radar", "snr", 60)


def test_only_the_owner_can_open_it(runtime: Path) -> None:
    with ControlServer("radar", Levels().set_level):
        folder, path = runtime / "murk", runtime / "murk" / "radar.gateway"
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert not path.exists()


def test_a_folder_that_others_can_write_to_is_refused(runtime: Path) -> None:
    (runtime / "murk").mkdir()
    (runtime / "murk").chmod(0o777)
    with pytest.raises(ControlError, match="is not a folder of yours alone"):
        ControlServer("radar", Levels().set_level)


def test_a_link_to_another_folder_is_refused(runtime: Path) -> None:
    (runtime / "elsewhere").mkdir(mode=0o700)
    (runtime / "murk").symlink_to(runtime / "elsewhere")
    with pytest.raises(ControlError):
        ControlServer("radar", Levels().set_level)


def test_another_user_is_turned_away(monkeypatch: pytest.MonkeyPatch) -> None:
    levels = Levels()
    with ControlServer("radar", levels.set_level):
        monkeypatch.setattr("node.control._user_of", lambda connection: os.getuid() + 1)
        with pytest.raises(ControlError):
            set_level("radar", "snr", 60)
    assert not levels.set


def test_a_second_gateway_of_a_sensor_is_refused_and_leaves_the_first_alone() -> None:
    levels = Levels()
    with ControlServer("radar", levels.set_level):
        with pytest.raises(ControlError, match="has a running gateway already"):
            ControlServer("radar", Levels().set_level)
        set_level("radar", "snr", 60)
    assert levels.set == [("snr", 60)]


def test_the_socket_of_a_crashed_gateway_is_replaced(runtime: Path) -> None:
    with ControlServer("other", Levels().set_level):
        pass  # makes the folder
    with socket.socket(socket.AF_UNIX) as crashed:
        crashed.bind(str(runtime / "murk" / "radar.gateway"))
    assert running() == []
    levels = Levels()
    with ControlServer("radar", levels.set_level):
        set_level("radar", "snr", 60)
    assert levels.set == [("snr", 60)]


@pytest.mark.parametrize(
    "line", [b"\n", b"{}\n", b'{"kind": "snr"}\n', b'{"kind": 1, "level": []}\n', b"\xff\n", b"7\n"]
)
def test_nonsense_is_answered_and_the_connection_goes_on(line: bytes, runtime: Path) -> None:
    levels = Levels()
    with ControlServer("radar", levels.set_level):
        good = b'{"kind": "snr", "level": 60}\n'
        answers = ask(runtime / "murk" / "radar.gateway", line, good)
    assert [answer["ok"] for answer in answers] == [False, True]
    assert levels.set == [("snr", 60)]


def test_a_silent_client_keeps_nobody_waiting(runtime: Path) -> None:
    levels = Levels()
    with ControlServer("radar", levels.set_level), socket.socket(socket.AF_UNIX) as silent:
        silent.connect(str(runtime / "murk" / "radar.gateway"))
        set_level("radar", "snr", 60)
    assert levels.set == [("snr", 60)]
