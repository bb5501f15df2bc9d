"""The micro-machine: Debian's kernel under QEMU, with real SocketCAN and V4L2, in two seconds.

::

    python -m tests.vm.machine -- .venv/bin/pytest tests/vm

runs a command in it, shows its output and exits with its exit status. In the machine

- the whole file system of this computer is there at the same paths, read-only; what is written
  goes to memory and is lost; temporary files go to ``/run``, which starts empty;
- ``vcan0`` and ``vcan1`` are up, ``/dev/video0`` and ``/dev/video1`` are vivid webcams;
- the command runs as root in the present folder, with ``MURK_VM=1`` in its environment, and
  ``MURK_VM_MODULES`` for ``modprobe -d``;
- Python is some twenty times slower than outside, but time is real.

Tests that need it are marked ``needs_machine`` (``tests.vm.marks``) and skipped elsewhere.
"""

from __future__ import annotations

import argparse
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.vm.kernel import Kernel, MachineError, make_initramfs, prepare_kernel, tool

KERNEL_LINE = (
    "console=ttyS0 quiet panic=-1 nokaslr mitigations=off tsc=reliable no_timer_check "
    "random.trust_cpu=on"
)
PASSED_ON = ("PATH", "LANG", "MURK_DATA", "HYPOTHESIS_PROFILE")
"""Environment variables that the command sees as they are here."""


def run_in_machine(
    command: Sequence[str],
    *,
    folder: Path | None = None,
    timeout_s: float = 900.0,
    show: Callable[[bytes], object] | None = None,
) -> tuple[int, bytes]:
    """Boot the machine, run a command in it and shut it down.

    Parameters
    ----------
    command:
        Program and arguments, paths as on this computer.
    folder:
        Where it runs; by default the present folder.
    timeout_s:
        Time for all of it.
    show:
        Gets the output (standard output and error) piece by piece as it comes.

    Returns
    -------
    status
        Exit status of the command.
    output
        All that it wrote.

    Raises
    ------
    MachineError
        If QEMU or a tool is missing, or the machine does not come to an end; one line.
    """
    tool("qemu-system-x86_64")
    kernel = prepare_kernel()
    with tempfile.TemporaryDirectory(prefix="murk-vm-") as scratch:
        share = Path(scratch)
        initramfs = make_initramfs(kernel.module_files(), share)
        (share / "command").write_text(script(command, folder or Path.cwd(), kernel))
        console = share / "console"
        with console.open("wb") as log, (share / "output").open("w+b") as output:
            process = subprocess.Popen(
                qemu(kernel, initramfs, share), stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )
            try:
                pieces = follow(process, output.read, time.monotonic() + timeout_s, show)
            finally:
                process.kill()
                process.wait()
        if not (share / "status").is_file():
            last = " ".join(console.read_text(errors="replace").split()[-40:])
            raise MachineError(f"the machine gave no exit status; its console ends: {last}")
        return int((share / "status").read_text()), b"".join(pieces)


def script(command: Sequence[str], folder: Path, kernel: Kernel) -> str:
    """Return the shell script that runs the command in its environment."""
    environment = {name: os.environ[name] for name in PASSED_ON if name in os.environ}
    environment |= {
        "HOME": "/run",
        "TMPDIR": "/run",
        "MURK_VM": "1",
        "MURK_VM_MODULES": str(kernel.folder),
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONUNBUFFERED": "1",
    }
    exports = [f"export {name}={shlex.quote(value)}" for name, value in environment.items()]
    return "\n".join([*exports, f"cd {shlex.quote(str(folder))}", shlex.join(command), ""])


def qemu(kernel: Kernel, initramfs: Path, share: Path) -> list[str]:
    """Return QEMU's command line: plain emulation, since KVM inside a machine may hang."""
    return [
        *(tool("qemu-system-x86_64"), "-accel", "tcg,thread=multi", "-cpu", "Nehalem,rdrand=on"),
        *("-smp", "2", "-m", "3072", "-nodefaults", "-no-user-config", "-no-reboot"),
        *("-display", "none", "-serial", "stdio"),
        *("-kernel", str(kernel.image), "-initrd", str(initramfs), "-append", KERNEL_LINE),
        "-fsdev",
        "local,id=root,path=/,security_model=none,readonly=on,multidevs=remap",
        *("-device", "virtio-9p-pci,fsdev=root,mount_tag=root"),
        *("-fsdev", f"local,id=share,path={share},security_model=none"),
        *("-device", "virtio-9p-pci,fsdev=share,mount_tag=share"),
        *("-device", "virtio-serial-pci", "-chardev", f"file,id=output,path={share / 'output'}"),
        *("-device", "virtserialport,chardev=output"),
    ]


def follow(
    process: subprocess.Popen[bytes],
    read: Callable[[], bytes],
    deadline: float,
    show: Callable[[bytes], object] | None,
) -> list[bytes]:
    """Collect what the command writes until the machine is off."""
    pieces: list[bytes] = []
    running = True
    while running:
        running = process.poll() is None
        if piece := read():
            pieces.append(piece)
            if show is not None:
                show(piece)
        if running and time.monotonic() > deadline:
            raise MachineError("the command took too long; the machine was switched off")
        time.sleep(0.05 if running else 0)
    return pieces


def main() -> int:
    """Run the command line; 125 where the machine itself fails."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.vm.machine",
        description="Run a command in the micro-machine with real SocketCAN and V4L2.",
    )
    parser.add_argument("--timeout", type=float, default=900.0, metavar="SECONDS")
    parser.add_argument("command", nargs=argparse.REMAINDER, help="-- PROGRAM [ARGUMENT ...]")
    options = parser.parse_args()
    command = options.command[1:] if options.command[:1] == ["--"] else options.command
    if not command:
        parser.error("no command given")

    def show(piece: bytes) -> None:
        sys.stdout.buffer.write(piece)
        sys.stdout.buffer.flush()

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that QEMU ends with us
    try:
        status, _ = run_in_machine(command, timeout_s=options.timeout, show=show)
    except MachineError as error:
        sys.stderr.write(f"micro-machine: {error}\n")
        return 125
    return status


if __name__ == "__main__":
    sys.exit(main())
