"""Other libraries' corruptions beside ours, one thread each, CPU time on the same image.

They live in an environment of their own, whose interpreter ``MURK_PEERS`` names (``pip install
imagecorruptions albumentations kornia torch 'setuptools<80' 'numpy<2'``); without it nothing is
compared. kornia is given float tensors: turning images into them and back is not counted.

What theirs leaves out is said beside it. Where that is most of what ours does, as with brightness
that is a table of bytes beside exposure through the lens, the pair counts for no goal; the blur and
the table that do the like together are a pair of their own. JPEG counts by itself: what encodes and
decodes by the same library cannot be many times as fast, and encoding alone is not.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from models.degrade.draw import DrawKey
from models.degrade.kinds import module_of
from models.evaluate import peers_worker
from models.evaluate.peers_worker import PAIRS, Pair
from models.evaluate.report import Goal, Result, Table
from models.evaluate.samples import textured_image
from models.evaluate.timing import cpu_time_us, one_thread

ASKED = {"imagecorruptions": 20.0, "albumentations": 1.0, "kornia": 1.0}
"""How many times faster ours shall be."""

_COLUMNS = ("ours", "ms", "theirs", "ms", "times", "what theirs is")


def run(quick: bool) -> Iterator[Result]:
    """Yield a table of all pairs, then goals: of each library the pair in which ours gains least.

    Raises
    ------
    InputError
        If ``MURK_PEERS`` names no interpreter that runs.
    """
    python = os.environ.get("MURK_PEERS")
    if python:
        yield from compare(textured_image(), python, quick)


def compare(image: NDArray[np.uint8], python: str, quick: bool) -> Iterator[Result]:
    """Compare on one image, (height, width, 3) uint8; see ``run``."""
    theirs = _theirs(image, python, quick)
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


def _theirs(image: NDArray[np.uint8], python: str, quick: bool) -> list[dict[str, Any]]:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "image.npy"
        np.save(file, image)
        command = [python, "-P", str(peers_worker.__file__), str(file), "1" if quick else "7"]
        try:
            lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        except (OSError, subprocess.CalledProcessError) as error:
            raise InputError("MURK_PEERS", f"{python} fails", str(error)) from error
    return [json.loads(line) for line in lines.splitlines()]


def _own_ms(pair: Pair, image: NDArray[np.uint8], quick: bool) -> float:
    module = module_of("camera", pair.ours)
    drawn = module.draw(pair.ours, pair.level, DrawKey(1, "bench", 0))
    return cpu_time_us(partial(module.apply, drawn, image), quick) / 1e3
