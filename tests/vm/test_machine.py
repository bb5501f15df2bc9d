"""The micro-machine itself: from outside without booting it, and the world that it promises."""

from __future__ import annotations

import lzma
import shutil
import struct
import subprocess
from pathlib import Path

import pytest

from tests.vm.kernel import Kernel, MachineError, decompress
from tests.vm.machine import qemu, run_in_machine, script
from tests.vm.marks import needs_machine

KERNEL = Kernel(Path("/kernel"))


def test_what_is_not_installed_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda *_, **__: None)
    with pytest.raises(MachineError, match="qemu-system-x86_64 is not installed; apt-get install"):
        run_in_machine(["true"])


def test_the_machine_is_plainly_emulated_and_cannot_write_to_the_root() -> None:
    if shutil.which("qemu-system-x86_64") is None:
        pytest.skip("QEMU is not installed")
    line = qemu(KERNEL, Path("/initramfs"), Path("/share"))
    assert not any("kvm" in argument for argument in line)
    assert all("readonly=on" in argument for argument in line if "path=/," in argument)


def test_arguments_reach_the_command_unchanged() -> None:
    awkward = ["printf", "%s", "two words; $HOME 'quoted' \"twice\" *"]
    text = script(awkward, Path("/"), KERNEL)
    result = subprocess.run(["sh", "-c", text], capture_output=True, text=True, check=True)
    assert result.stdout == awkward[2]


def test_the_kernel_is_found_inside_its_compressed_image() -> None:
    """Linux x86 boot protocol: setup_sects at 0x1F1, payload offset and length from 0x248."""
    kernel = b"\x7fELF" + bytes(range(256)) * 20
    payload = lzma.compress(kernel)
    image = bytearray(3 * 512 + 100 + len(payload) + 50)
    image[0x1F1] = 2
    struct.pack_into("<II", image, 0x248, 100, len(payload))
    image[3 * 512 + 100 : 3 * 512 + 100 + len(payload)] = payload
    assert decompress(bytes(image)) == kernel


@needs_machine
def test_two_can_buses_and_two_cameras_are_there() -> None:
    for bus in ("vcan0", "vcan1"):
        flags = int(Path("/sys/class/net", bus, "flags").read_text(), 16)
        assert flags & 1, f"{bus} is down"
    cards = [Path(f"/sys/class/video4linux/video{i}/name").read_text() for i in (0, 1)]
    assert cards == ["vivid-000-vid-cap\n", "vivid-001-vid-cap\n"]


@needs_machine
def test_the_root_is_the_hosts_and_a_write_stays_here() -> None:
    here = Path(__file__).with_name("written-in-the-machine")
    here.write_text("gone when it is off")
    assert here.read_text() == "gone when it is off"
