"""Debian's kernel for the micro-machine, fetched once, and the initramfs that starts it.

The kernel is kept in ``.cache/vm`` (``$XDG_CACHE_HOME/murk/vm`` where that is set), in a folder
named after its package; remove the folder to fetch the newest.
"""

from __future__ import annotations

import hashlib
import lzma
import os
import shutil
import struct
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
INIT = Path(__file__).with_name("init.sh")

MODULES = (
    *("virtio_pci", "virtio_console", "9pnet_virtio", "9p", "overlay"),
    *("vcan", "can_raw", "can_gw", "vivid"),
)

DEBIAN_PACKAGES = "qemu-system-x86 busybox-static cpio kmod can-utils v4l-utils iproute2"
"""What must be installed for the machine and its tests; QEMU brings its BIOS along."""


class MachineError(Exception):
    """The micro-machine cannot be made or does not start; the message is one line."""


@dataclass(frozen=True, slots=True)
class Kernel:
    """A kernel in the cache.

    Attributes
    ----------
    folder:
        Holds ``vmlinux``, uncompressed because that boots in half the time, and ``lib/modules``
        for ``modprobe -d``.
    """

    folder: Path

    @property
    def image(self) -> Path:
        """The kernel that QEMU boots."""
        return self.folder / "vmlinux"

    def module_files(self) -> list[Path]:
        """Return the files to load for ``MODULES``, in order, each once."""
        version = next((self.folder / "lib" / "modules").iterdir()).name
        return module_files(self.folder, version)


def prepare_kernel() -> Kernel:
    """Return the kernel from the cache; the first time, fetch Debian's and unpack it there.

    Raises
    ------
    MachineError
        If a tool is missing or the package cannot be fetched.
    """
    cache = cache_folder()
    suffix = hashlib.sha256(" ".join(MODULES).encode()).hexdigest()[:6]
    kept = sorted(cache.glob(f"linux-image-*+{suffix}"))
    if kept:
        return Kernel(kept[-1])
    package = newest_package()
    folder = cache / f"{package}+{suffix}"
    cache.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=cache) as scratch:
        unpack(package, Path(scratch))
        publish(Path(scratch, "kernel"), folder)
    return Kernel(folder)


def cache_folder() -> Path:
    """Return the folder that outlives a run."""
    home = os.environ.get("XDG_CACHE_HOME")
    return Path(home, "murk", "vm") if home else ROOT / ".cache" / "vm"


def newest_package() -> str:
    """Return the package behind Debian's ``linux-image-amd64``."""
    listing = run("apt-cache", "depends", "linux-image-amd64")
    for line in listing.splitlines():
        if "Depends: linux-image-" in line:
            return line.split()[-1]
    raise MachineError("apt-cache knows no linux-image-amd64; run apt-get update on Debian amd64")


def unpack(package: str, scratch: Path) -> None:
    """Fetch the package and leave what the machine needs in ``scratch/kernel``."""
    run("apt-get", "download", package, folder=scratch)
    unpacked, kernel = scratch / "unpacked", scratch / "kernel"
    run("dpkg", "-x", str(next(scratch.glob("*.deb"))), str(unpacked))
    modules = next((unpacked / "lib" / "modules").iterdir())
    run("depmod", "-b", str(unpacked), modules.name)
    indices = modules.glob("modules.[bo]*")  # depmod reads modules.builtin* and modules.order
    for path in [*module_files(unpacked, modules.name), *indices]:
        target = kernel / path.relative_to(unpacked)
        target.parent.mkdir(parents=True, exist_ok=True)
        path.rename(target)
    run("depmod", "-b", str(kernel), modules.name)
    image = (unpacked / "boot" / f"vmlinuz-{modules.name}").read_bytes()
    (kernel / "vmlinux").write_bytes(decompress(image))


def module_files(base: Path, version: str) -> list[Path]:
    """Return the files to load for ``MODULES``, in order, each once."""
    options = ("-d", str(base), "-S", version, "--show-depends", "--all")
    lines = run("modprobe", *options, *MODULES).splitlines()
    files = [
        Path(line.removeprefix("insmod ").strip()) for line in lines if line.startswith("insmod ")
    ]
    return list(dict.fromkeys(files))


def decompress(image: bytes) -> bytes:
    """Return the ELF kernel inside a bzImage (Linux x86 boot protocol, 2.08 and later)."""
    setup_sectors = image[0x1F1]
    offset, length = struct.unpack_from("<II", image, 0x248)
    start = (setup_sectors + 1) * 512 + offset
    return lzma.LZMADecompressor().decompress(image[start : start + length])


def make_initramfs(modules: Sequence[Path], scratch: Path) -> Path:
    """Pack busybox, ``init.sh`` and ``modules``, which it loads in the order of their names."""
    tree = scratch / "initramfs"
    for folder in ("bin", "dev", "proc", "sys", "modules", "host", "overlay", "newroot"):
        (tree / folder).mkdir(parents=True)
    shutil.copy(tool("busybox"), tree / "bin" / "busybox")
    shutil.copy(INIT, tree / "init")
    (tree / "init").chmod(0o755)
    for index, module in enumerate(modules):
        shutil.copy(module, tree / "modules" / f"{index:02}-{module.name}")
    names = sorted(str(entry.relative_to(tree)) for entry in tree.rglob("*"))
    archive = scratch / "initramfs.cpio"
    options = ("--quiet", "-o", "-H", "newc", "-F", str(archive))
    run("cpio", *options, folder=tree, standard_input="\n".join(names))
    return archive


def publish(built: Path, target: Path) -> None:
    """Give the built folder its name, unless somebody else has built the same meanwhile."""
    try:
        built.rename(target)
    except OSError:
        if not target.is_dir():
            raise


def tool(name: str) -> str:
    """Return where a program is.

    Raises
    ------
    MachineError
        If it is not installed.
    """
    found = shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")
    if found is None:
        raise MachineError(f"{name} is not installed; apt-get install {DEBIAN_PACKAGES}")
    return found


def run(name: str, *arguments: str, folder: Path | None = None, standard_input: str = "") -> str:
    """Run a program and return its output.

    Raises
    ------
    MachineError
        If it is not installed or fails.
    """
    result = subprocess.run(
        [tool(name), *arguments],
        input=standard_input,
        capture_output=True,
        text=True,
        cwd=folder,
        check=False,
    )
    if result.returncode:
        reason = " ".join(result.stderr.split())
        raise MachineError(f"{name} {' '.join(arguments)} failed: {reason}")
    return result.stdout
