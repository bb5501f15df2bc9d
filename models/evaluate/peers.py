"""How much faster the degradations are than other libraries' corruptions of the same name.

The other libraries live in an environment of their own, whose interpreter ``MURK_PEERS`` names
(``pip install imagecorruptions albumentations 'setuptools<80'``); without it nothing is compared.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from models.evaluate import peers_worker
from models.evaluate.report import Goal

_ASKED = {"imagecorruptions": 20.0, "albumentations": 1.0}


def compare(image: NDArray[np.uint8], own_us: Mapping[str, float], quick: bool) -> Iterator[Goal]:
    """Yield a goal a corruption that both have: their CPU time over ours, one thread each.

    Parameters
    ----------
    image:
        (height, width, 3) uint8.
    own_us:
        Our time by kind, µs.

    Raises
    ------
    InputError
        If ``MURK_PEERS`` names no interpreter that runs.
    """
    python = os.environ.get("MURK_PEERS")
    if not python:
        return
    with TemporaryDirectory() as folder:
        file = Path(folder) / "image.npy"
        np.save(file, image)
        command = [python, "-P", str(peers_worker.__file__), str(file), "1" if quick else "7"]
        try:
            lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        except (OSError, subprocess.CalledProcessError) as error:
            raise InputError("MURK_PEERS", f"{python} fails", str(error)) from error
    for line in lines.splitlines():
        peer = json.loads(line)
        if "ms" in peer:
            name = f"{peer['ours']}, times faster than {peer['library']} {peer['theirs']}"
            yield Goal(name, peer["ms"] * 1e3 / own_us[peer["ours"]], _ASKED[peer["library"]])
