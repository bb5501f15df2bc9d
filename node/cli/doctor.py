"""``murk doctor``: what is installed, which devices and buses exist, which models load."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from dbc.errors import MurkError
from node.cli.output import emit, plain_console

REQUIRED = (
    "av",
    "cantools",
    "crccheck",
    "matplotlib",
    "mcap",
    "numpy",
    "onnxruntime",
    "opencv-contrib-python-headless",
    "pillow",
    "pydantic",
    "python-can",
    "rich",
    "rosbags",
    "simplejpeg",
    "stringzilla",
    "stringzilla",
    "typer",
    "zstandard",
)
EXTRAS = {
    "ros2": ("cyclonedds",),
    "scale": ("dask", "distributed"),
    "train": ("onnx", "onnxscript", "scikit-learn", "torch"),
    "view": ("aiohttp",),
}
ARPHRD_CAN = "280"
"""Type of a CAN interface in /sys/class/net (linux/if_arp.h)."""


class Finding(NamedTuple):
    """One thing that was looked at; ``ok`` is None where its absence is no fault."""

    area: str
    name: str
    ok: bool | None
    detail: str


def doctor(
    json: Annotated[bool, typer.Option("--json", help="One JSON object a finding.")] = False,
) -> None:
    """Look at libraries, buses, cameras and models; exit 1 if murk cannot work here."""
    findings = [
        *_libraries(),
        *_can_interfaces(),
        *_cameras(),
        *_parts(),
    ]
    if json:
        for finding in findings:
            emit({"type": "finding", **finding._asdict()})
    else:
        _print(findings)
    if any(finding.ok is False for finding in findings):
        raise typer.Exit(1)


def _libraries() -> Iterator[Finding]:
    yield Finding("python", platform.python_implementation(), True, platform.python_version())
    for name in REQUIRED:
        version = _version(name)
        yield Finding("library", name, version is not None, version or "not installed")
    for extra, names in EXTRAS.items():
        for name in names:
            version = _version(name)
            absent = f"not installed: pip install 'murk[{extra}]'"
            yield Finding(f"extra {extra}", name, version is not None or None, version or absent)


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _can_interfaces() -> Iterator[Finding]:
    network = Path("/sys/class/net")
    kinds = sorted(network.glob("*/type")) if network.is_dir() else []
    interfaces = [kind.parent for kind in kinds if kind.read_text().strip() == ARPHRD_CAN]
    for interface in interfaces:
        state = (interface / "operstate").read_text().strip()
        yield Finding("CAN", interface.name, True, state)
    if not interfaces:
        hint = "none; for a virtual one: ip link add dev vcan0 type vcan && ip link set vcan0 up"
        yield Finding("CAN", "interfaces", None, hint)


def _cameras() -> Iterator[Finding]:
    devices = sorted(Path("/sys/class/video4linux").glob("video*"))
    for device in devices:
        yield Finding("camera", f"/dev/{device.name}", True, (device / "name").read_text().strip())
    if not devices:
        yield Finding("camera", "devices", None, "none")


def _parts() -> Iterator[Finding]:
    yield _try("database", "ars408.dbc", _load_database)
    yield _try("database", "noise_level.dbc", _load_noise_level)
    yield _try("model", "camera", _load_camera)
    yield _try("model", "radar", _load_radar)


def _try(area: str, name: str, load: Callable[[], str]) -> Finding:
    try:
        return Finding(area, name, True, load())
    except (MurkError, ImportError) as error:
        return Finding(area, name, False, str(error))


def _load_database() -> str:
    from dbc.codec import ars408

    ars408()
    return "compiles"


def _load_noise_level() -> str:
    from dbc.codec import noise_level

    noise_level()
    return "compiles"


def _load_camera() -> str:
    from models.estimate.camera import CameraEstimator

    CameraEstimator()
    return "loads"


def _load_radar() -> str:
    from models.estimate.radar import RadarEstimator

    RadarEstimator()
    return "loads"


def _print(findings: list[Finding]) -> None:
    from rich.table import Table
    from rich.text import Text

    marks = {True: Text("ok", "green"), False: Text("fault", "red"), None: Text("absent", "dim")}
    table = Table("", "", "", "")
    for finding in findings:
        table.add_row(finding.area, finding.name, marks[finding.ok], finding.detail)
    plain_console().print(table)
