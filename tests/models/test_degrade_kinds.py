"""What holds for every kind of degradation there is."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from degrade_scans import make_scan

from models.degrade.draw import DrawKey
from models.degrade.kinds import KINDS, module_of
from models.evaluate.samples import textured_image

EVERY = [(sensor, kind) for sensor, kinds in KINDS.items() for kind in kinds]


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
    module = module_of(sensor, kind)
    drawn = module.draw(kind, 60, DrawKey(4, sensor, sequence))
    return as_bytes(module.apply(drawn, message(sensor)))


@pytest.mark.parametrize("sensor", KINDS)
def test_the_list_of_kinds_is_that_of_the_modules(sensor):
    kinds = KINDS[sensor]
    assert len(set(kinds)) == len(kinds)
    modules = {module_of(sensor, kind) for kind in kinds}
    assert set(kinds) == {kind for module in modules for kind in module.KINDS}


@pytest.mark.parametrize("kind", KINDS["camera"])
def test_level_0_is_the_identity_and_the_input_stays(kind):
    image = message("camera")
    before = image.copy()
    module = module_of("camera", kind)
    assert module.apply(module.draw(kind, 0, DrawKey(1, "camera", 3)), image) is image
    for level in (1e-9, 50, 100):
        drawn = module.draw(kind, level, DrawKey(1, "camera", 3))
        first, second = module.apply(drawn, image), module.apply(drawn, image)
        assert (first.dtype, first.shape) == (np.uint8, image.shape)
        np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("kind", KINDS["camera"])
def test_each_level_departs_farther_from_the_image(kind):
    image = (0.7 * textured_image(180, 320)).astype(np.uint8)  # over-exposure has where to go
    module = module_of("camera", kind)
    errors = [
        np.abs(module.apply(module.draw(kind, level, DrawKey(1, "camera", 3)), image) - 1.0 * image)
        for level in range(0, 101, 10)
    ]
    assert (np.diff([error.mean() for error in errors]) > 0).all()
    assert errors[-1].mean() > 2


@pytest.mark.parametrize(("sensor", "kind"), EVERY)
def test_the_same_bytes_on_one_and_on_eight_threads_forwards_and_shuffled(sensor, kind):
    threads = cv2.getNumThreads()
    try:
        cv2.setNumThreads(1)
        forwards = [degrade(sensor, kind, sequence) for sequence in range(8)]
        order = [5, 2, 7, 0, 3, 6, 1, 4]
        cv2.setNumThreads(8)
        with ThreadPoolExecutor(8) as pool:
            shuffled = dict(
                zip(order, pool.map(lambda k: degrade(sensor, kind, k), order), strict=True)
            )
    finally:
        cv2.setNumThreads(threads)
    assert [shuffled[sequence] for sequence in range(8)] == forwards


def test_another_process_gives_the_same_bytes():
    code = (
        "import hashlib, test_degrade_kinds as t;"
        "print(hashlib.sha256(b''.join(t.degrade(*k, 3) for k in t.EVERY)).hexdigest())"
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


@pytest.mark.parametrize(("sensor", "kind"), EVERY)
@pytest.mark.parametrize("level", [1e-9, 100])
def test_a_read_only_message_is_enough(sensor, kind, level):
    given = message(sensor)
    arrays = [given] if isinstance(given, np.ndarray) else list(given.arrays().values())
    for array in arrays:
        array.setflags(write=False)
    module = module_of(sensor, kind)
    module.apply(module.draw(kind, level, DrawKey(4, sensor, 3)), given)


def test_radar_kinds_load_no_image_library():
    code = "import sys; from models.degrade.kinds import KINDS, module_of as m;"
    code += "[m('radar', kind) for kind in KINDS['radar']]; print('cv2' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert run.stdout == "False\n"
