"""Other libraries' corruptions beside ours, one thread each, CPU time on the same image.

They live in an environment of their own, whose interpreter ``MURK_PEERS`` names (``pip install
imagecorruptions albumentations kornia torch 'setuptools<80' 'numpy<2'``); without it nothing is
compared. kornia is given float tensors: turning images into them and back is not counted.

What theirs leaves out is said beside it. Where that is most of what ours does, as with brightness
that is a table of bytes beside exposure through the lens, the pair counts for no goal; the blur and
the table that do the like together are a pair of their own.

JPEG counts by itself: what encodes and decodes by the same library cannot be many times as fast.
Of every codec that is installed there (``pip install imagecodecs simplejpeg``) the two calls alone
are in a table, with how far their picture is from ours: imagecorruptions spends its time in them,
as we do, and none takes a twentieth of it.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from models.degrade import imager
from models.degrade.draw import DrawKey
from models.degrade.kinds import module_of
from models.evaluate import peers_jpeg, peers_worker
from models.evaluate.peers_worker import PAIRS, Pair
from models.evaluate.report import Goal, Result, Table
from models.evaluate.samples import textured_image
from models.evaluate.timing import cpu_time_us, one_thread

ASKED = {"imagecorruptions": 20.0, "albumentations": 1.0, "kornia": 1.0}
"""How many times faster ours shall be."""

_COLUMNS = ("ours", "ms", "theirs", "ms", "times", "what theirs is")
_CODEC_COLUMNS = (
    "codec", "quality", "encoding, ms", "decoding, ms", "greatest difference from ours, counts",
)  # fmt: skip
_CODEC_LEVELS = (1.0, 63.0)


def run(quick: bool) -> Iterator[Result]:
    """Yield a table of all pairs, then goals: of each library the pair in which ours gains least.

    Last comes a table of JPEG codecs.

    Raises
    ------
    InputError
        If ``MURK_PEERS`` names no interpreter that runs.
    """
    python = os.environ.get("MURK_PEERS")
    if python:
        yield from compare(textured_image(), python, quick)
        yield codecs(textured_image(), python, quick)


def compare(image: NDArray[np.uint8], python: str, quick: bool) -> Iterator[Result]:
    """Compare on one image, (height, width, 3) uint8; see ``run``."""
    theirs = _told(python, peers_worker, quick, image=image)
    with one_thread():
        ours = [_own_ms(pair, image, quick) for pair in PAIRS]
    rows: list[tuple[str | float, ...]] = []
    gains: dict[str, dict[str, float]] = {}
    for pair, record, own in zip(PAIRS, theirs, ours, strict=True):
        name, other = f"{pair.ours}, {pair.level:g} %", f"{pair.library} {pair.theirs}"
        if "ms" in record:
            gain = record["ms"] / own
            codec = pair.theirs_is.startswith("the same codec")
            group = f"{pair.library}, by the same codec" if codec else pair.library
            if not pair.does_less:
                gains.setdefault(group, {})[f"{pair.ours}, {pair.theirs}"] = gain
            rows.append((name, own, other, record["ms"], gain, pair.theirs_is))
        elif "No module" not in record["fault"]:
            rows.append((name, own, other, record["fault"], "", pair.theirs_is))
    yield Table("Other libraries", _COLUMNS, tuple(rows))
    for group, by_pair in gains.items():
        least = min(by_pair, key=lambda pair: by_pair[pair])
        asked = ASKED[group.partition(",")[0]]
        yield Goal(f"times as fast as {group} ({least})", by_pair[least], asked)


def codecs(image: NDArray[np.uint8], python: str, quick: bool) -> Table:
    """Return what each JPEG codec takes on one image, (height, width, 3) uint8."""
    pictures = {}
    for level in _CODEC_LEVELS:
        drawn: Any = imager.draw("jpeg", level, DrawKey(1, "bench", 0))
        pictures[str(drawn.quality)] = imager.apply(drawn, image)
    found = _told(python, peers_jpeg, quick, image=image, **pictures)
    return Table("JPEG codecs", _CODEC_COLUMNS, tuple(tuple(one.values()) for one in found))


def _told(
    python: str, worker: ModuleType, quick: bool, **images: NDArray[np.uint8]
) -> list[dict[str, Any]]:
    """Return what another interpreter says that runs a worker on some images by name."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "images.npz"
        np.savez(file, allow_pickle=False, **images)
        command = [python, "-P", str(worker.__file__), str(file), "1" if quick else "7"]
        try:
            lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        except (OSError, subprocess.CalledProcessError) as error:
            raise InputError("MURK_PEERS", f"{python} fails", str(error)) from error
    return [json.loads(line) for line in lines.splitlines()]


def _own_ms(pair: Pair, image: NDArray[np.uint8], quick: bool) -> float:
    module = module_of("camera", pair.ours)
    drawn = module.draw(pair.ours, pair.level, DrawKey(1, "bench", 0))
    return cpu_time_us(partial(module.apply, drawn, image), quick) / 1e3
