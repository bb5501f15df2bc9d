"""Debian's kernel and an initramfs for the micro-machine, fetched and built once.

They are kept in ``.cache/vm`` (``$XDG_CACHE_HOME/murk/vm`` where that is set), in a folder named
after the kernel: a new kernel, or a changed ``init.sh``, gets a folder of its own.
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
    """Paths of what QEMU boots.

    Attributes
    ----------
    image:
        Uncompressed kernel: it boots in half the time of the compressed one.
    initramfs:
        Archive of busybox, ``init.sh`` and the modules.
    modules:
        Folder for ``modprobe -d``; it holds ``lib/modules``.
    """

    image: Path
    initramfs: Path
    modules: Path


def prepare() -> Kernel:
    """Return the kernel from the cache; the first time, fetch Debian's and unpack it there.

    Raises
    ------
    MachineError
        If a tool is missing or the package cannot be fetched.
    """
    cache = cache_folder()
    built = sorted(cache.glob(f"linux-image-*-{fingerprint()}"))
    if not built:
        package = newest_package()
        built = [cache / f"{package}-{fingerprint()}"]
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache) as scratch:
            build(package, Path(scratch))
            publish(Path(scratch, "kernel"), built[0])
    folder = built[-1]
    return Kernel(folder / "vmlinux", folder / "initramfs", folder)


def cache_folder() -> Path:
    """Return the folder that outlives a run."""
    home = os.environ.get("XDG_CACHE_HOME")
    return Path(home, "murk", "vm") if home else ROOT / ".cache" / "vm"


def fingerprint() -> str:
    """Return a hash of what the initramfs is made from beside the kernel."""
    return hashlib.sha256(INIT.read_bytes() + Path(__file__).read_bytes()).hexdigest()[:8]


def newest_package() -> str:
    """Return the package behind Debian's ``linux-image-amd64``."""
    listing = run("apt-cache", "depends", "linux-image-amd64")
    for line in listing.splitlines():
        if "Depends: linux-image-" in line:
            return line.split()[-1]
    raise MachineError("apt-cache knows no linux-image-amd64; run apt-get update on Debian amd64")


def build(package: str, scratch: Path) -> None:
    """Fetch the package and leave what the machine needs in ``scratch/kernel``."""
    run("apt-get", "download", package, folder=scratch)
    unpacked, kernel = scratch / "unpacked", scratch / "kernel"
    run("dpkg", "-x", str(next(scratch.glob("*.deb"))), str(unpacked))
    version = next((unpacked / "lib" / "modules").iterdir()).name
    run("depmod", "-b", str(unpacked), version)
    modules = with_dependencies(MODULES, unpacked, version)
    for path in modules:
        target = kernel / path.relative_to(unpacked)
        target.parent.mkdir(parents=True, exist_ok=True)
        path.rename(target)
    for path in (unpacked / "lib" / "modules" / version).glob("modules.[bo]*"):
        path.rename(kernel / path.relative_to(unpacked))
    run("depmod", "-b", str(kernel), version)
    image = (unpacked / "boot" / f"vmlinuz-{version}").read_bytes()
    (kernel / "vmlinux").write_bytes(decompress(image))
    files = [kernel / path.relative_to(unpacked) for path in modules]
    make_initramfs(files, kernel / "initramfs")


def with_dependencies(modules: Sequence[str], base: Path, version: str) -> list[Path]:
    """Return the files to load for ``modules``, in order, each once."""
    lines = (
        line
        for module in modules
        for line in run(
            "modprobe", "-d", str(base), "-S", version, "--show-depends", module
        ).splitlines()
    )
    files = [Path(line.split()[1]) for line in lines if line.startswith("insmod")]
    return list(dict.fromkeys(files))


def decompress(image: bytes) -> bytes:
    """Return the ELF kernel inside a bzImage (Linux x86 boot protocol, 2.08 and later)."""
    setup_sectors = image[0x1F1]
    offset, length = struct.unpack_from("<II", image, 0x248)
    start = (setup_sectors + 1) * 512 + offset
    return lzma.LZMADecompressor().decompress(image[start : start + length])


def make_initramfs(modules: Sequence[Path], path: Path) -> None:
    """Pack busybox, ``init.sh`` and ``modules``, which it loads in the order of their names."""
    with tempfile.TemporaryDirectory(dir=path.parent) as scratch:
        tree = Path(scratch)
        for folder in ("bin", "dev", "proc", "sys", "modules", "host", "overlay", "root"):
            (tree / folder).mkdir()
        shutil.copy(tool("busybox"), tree / "bin" / "busybox")
        shutil.copy(INIT, tree / "init")
        (tree / "init").chmod(0o755)
        for index, module in enumerate(modules):
            shutil.copy(module, tree / "modules" / f"{index:02}-{module.name}")
        names = sorted(str(entry.relative_to(tree)) for entry in tree.rglob("*"))
        packed = subprocess.run(
            [tool("cpio"), "--quiet", "-o", "-H", "newc"],
            input="\n".join(names).encode(),
            capture_output=True,
            cwd=tree,
            check=True,
        )
    path.write_bytes(packed.stdout)


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


def run(name: str, *arguments: str, folder: Path | None = None) -> str:
    """Run a program and return its output.

    Raises
    ------
    MachineError
        If it is not installed or fails.
    """
    result = subprocess.run(
        [tool(name), *arguments], capture_output=True, text=True, cwd=folder, check=False
    )
    if result.returncode:
        reason = " ".join(result.stderr.split())
        raise MachineError(f"{name} {' '.join(arguments)} failed: {reason}")
    return result.stdout
