"""What cannot be opened or does not answer: one line, exit status 2, nothing left half-open."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.can_bus import open_bus
from node import cli
from tests.vm.marks import INSIDE, needs_machine

if INSIDE:
    from drivers.v4l2 import V4L2Camera

pytestmark = needs_machine

NOBODY = 65534


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def no_bus() -> Iterator[None]:
    """Both buses down."""
    for bus in ("vcan0", "vcan1"):
        subprocess.run(["ip", "link", "set", bus, "down"], check=True)
    yield
    for bus in ("vcan0", "vcan1"):
        subprocess.run(["ip", "link", "set", bus, "up"], check=True)


@contextmanager
def as_nobody() -> Iterator[None]:
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)


class Murk:
    """Runs commands in this process, where starting Python would take half a minute."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, told: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch = monkeypatch
        self._told = told

    def refuses(self, command: str) -> str:
        """Run a command that must fail as bad input does; return its one line."""
        before = open_devices()
        self._monkeypatch.setattr("sys.argv", ["murk", *command.split()])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        told = self._told.readouterr()
        assert (ended.value.code, told.out) == (2, ""), told
        assert len(told.err.splitlines()) == 1, told.err
        assert open_devices() == before, "something is left open"
        return told.err.removeprefix("murk: ").rstrip()


@pytest.fixture
def murk(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Murk:
    return Murk(monkeypatch, capsys)


def open_devices() -> list[str]:
    """Return the devices and sockets, of buses and of live control, that this process has open."""
    links = [link for link in Path("/proc/self/fd").iterdir() if link.is_symlink()]
    targets = [str(link.readlink()) for link in links]
    return sorted(one for one in targets if one.startswith(("/dev/video", "socket")))


@pytest.mark.parametrize(
    "command",
    [
        "run --radar vcan77",
        "gateway vcan77 vcan1",
        "gateway vcan0 vcan77",
        "play drive.log vcan77",
        "radar status vcan77",
    ],
)
def test_an_interface_that_does_not_exist(murk: Murk, command: str) -> None:
    Path("drive.log").write_text("(0.000000) can0 701#004F5A12771FE187\n")
    assert murk.refuses(command).startswith(
        "vcan77: there is no such CAN interface; there are vcan"
    )


@pytest.mark.usefixtures("no_bus")
@pytest.mark.parametrize(
    "command",
    [
        "run --radar vcan0",
        "gateway vcan0 vcan1",
        "play drive.log vcan0",
        "radar configure vcan0 --output clusters",
    ],
)
def test_an_interface_that_is_down(murk: Murk, command: str) -> None:
    Path("drive.log").write_text("(0.000000) can0 701#004F5A12771FE187\n")
    assert murk.refuses(command) == "vcan0: the interface is down; ip link set vcan0 up"


def test_an_output_that_is_down_closes_the_input(murk: Murk) -> None:
    subprocess.run(["ip", "link", "set", "vcan1", "down"], check=True)
    try:
        assert murk.refuses("gateway vcan0 vcan1").startswith("vcan1: the interface is down")
    finally:
        subprocess.run(["ip", "link", "set", "vcan1", "up"], check=True)


def test_a_radar_that_never_answers(murk: Murk) -> None:
    with open_bus("vcan0"):
        assert "vcan0" in murk.refuses("radar status vcan0 --timeout 0.5")
        assert "vcan0" in murk.refuses("radar configure vcan0 --output clusters --timeout 0.5")


def test_a_camera_that_is_busy(murk: Murk) -> None:
    with V4L2Camera("/dev/video0", "other") as camera:
        next(camera)
        assert murk.refuses("run --camera /dev/video0").startswith("/dev/video0: is busy")
        assert murk.refuses("gateway /dev/video0 x.mp4").startswith("/dev/video0: is busy")
        assert next(camera).image.any()
    assert not list(Path.cwd().glob("*.mp4*"))


@pytest.mark.parametrize(
    "command",
    [
        "run --camera /dev/null",
        "run --camera /dev/video9",
        "gateway /dev/null x.mp4",
        "gateway /dev/video0 /dev/null",
        "gateway /dev/video0 /dev/video1",
    ],
)
def test_what_is_no_camera_and_no_output(murk: Murk, command: str) -> None:
    device = murk.refuses(command).split(":")[0]
    assert device in command.split()
    assert not list(Path.cwd().glob("*.mp4*"))


def test_no_permission(murk: Murk, tmp_path: Path) -> None:
    camera = Path("/dev/video0")
    camera.chmod(0o600)
    tmp_path.chmod(0o777)
    try:
        with as_nobody():
            told = murk.refuses("run --camera /dev/video0")
    finally:
        camera.chmod(0o660)
    assert told.startswith("/dev/video0: ")


def test_a_control_command_for_a_sensor_that_is_not_there(murk: Murk) -> None:
    assert murk.refuses("gateway set radar snr 60").startswith("radar: has no running gateway")
