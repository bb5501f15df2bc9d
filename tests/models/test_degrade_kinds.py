"""What holds for every kind of degradation there is."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from degrade_scans import make_scan

from models.degrade import MODULES, load
from models.degrade.draw import DrawKey

KINDS = [(sensor, kind) for sensor in MODULES for kind in load(sensor)]


def message(sensor):
    if sensor == "radar":
        x = np.linspace(2, 90, 100)
        return make_scan(x, 3 * np.sin(x), vx=-8.0, rcs=np.linspace(-5, 25, 100))
    rows, columns = np.mgrid[:200, :300]
    return np.dstack([rows, columns % 256, (rows + columns) % 256]).astype(np.uint8)


def as_bytes(result):
    if isinstance(result, np.ndarray):
        return result.tobytes()
    return b"".join(array.tobytes() for array in result.arrays().values())


def degrade(sensor, kind, sequence):
    module = load(sensor)[kind]
    drawn = module.draw(kind, 60, DrawKey(4, sensor, sequence))
    return as_bytes(module.apply(drawn, message(sensor)))


def test_no_two_modules_have_the_same_kind():
    from importlib import import_module

    for sensor, names in MODULES.items():
        count = sum(len(import_module(f"models.degrade.{name}").KINDS) for name in names)
        assert count == len(load(sensor))


@pytest.mark.parametrize(("sensor", "kind"), KINDS)
def test_the_same_bytes_on_one_and_on_eight_threads_forwards_and_shuffled(sensor, kind):
    forwards = [degrade(sensor, kind, sequence) for sequence in range(8)]
    order = [5, 2, 7, 0, 3, 6, 1, 4]
    with ThreadPoolExecutor(8) as pool:
        shuffled = dict(
            zip(order, pool.map(lambda k: degrade(sensor, kind, k), order), strict=True)
        )
    assert [shuffled[sequence] for sequence in range(8)] == forwards


def test_another_process_gives_the_same_bytes():
    code = (
        "import hashlib, test_degrade_kinds as t;"
        "print(hashlib.sha256(b''.join(t.degrade(*k, 3) for k in t.KINDS)).hexdigest())"
    )
    path = ":".join(sys.path)
    runs = {
        subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONPATH": path, "PYTHONHASHSEED": str(seed)},
            check=True, capture_output=True, text=True,
        ).stdout
        for seed in (1, 2)
    }  # fmt: skip
    assert len(runs) == 1


@pytest.mark.parametrize(("sensor", "kind"), KINDS)
@pytest.mark.parametrize("level", [1e-9, 100])
def test_a_read_only_message_is_enough(sensor, kind, level):
    given = message(sensor)
    arrays = [given] if isinstance(given, np.ndarray) else list(given.arrays().values())
    for array in arrays:
        array.setflags(write=False)
    module = load(sensor)[kind]
    module.apply(module.draw(kind, level, DrawKey(4, sensor, 3)), given)


def test_radar_kinds_load_no_image_library():
    code = "import sys; from models.degrade import load; load('radar'); print('cv2' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert run.stdout == "False\n"
