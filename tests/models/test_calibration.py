from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dbc.errors import InputError
from drivers.frame import Frame
from models.estimate.calibration import Calibration, fit
from models.estimate.level import LEVELS, Estimate
from models.evaluate.calibrate import MOST_ANSWERS, calibrate

IDENTITY = Calibration("camera", {}, 1.0, (0.0,) * 11)


def reading(level: float, kind: str = "blur", width: float = 8.0) -> Estimate:
    weights = np.exp(-(((LEVELS - level) / width) ** 2))
    return Estimate(weights / weights.sum(), {"clean": 0.0, kind: 1.0})


@given(st.lists(st.floats(1e-5, 1), min_size=11, max_size=11))
def test_the_identity_changes_nothing(weights: list[float]) -> None:
    estimate = Estimate(np.array(weights) / sum(weights), {"clean": 0.3, "blur": 0.7})
    corrected = IDENTITY.apply(estimate)
    np.testing.assert_allclose(corrected.probabilities, estimate.probabilities, atol=1e-4)
    assert corrected.kind_probabilities == estimate.kind_probabilities


@given(
    st.floats(0.1, 5),
    st.floats(-60, 60),
    st.floats(0.01, 5),
    st.lists(st.floats(-20, 20), min_size=11, max_size=11),
    st.sampled_from(LEVELS.tolist()),
)
def test_any_correction_gives_probabilities(
    slope: float, offset: float, exponent: float, offsets: list[float], level: float
) -> None:
    correction = Calibration("radar", {"blur": (slope, offset)}, exponent, tuple(offsets))
    corrected = correction.apply(reading(level)).probabilities
    assert np.all(corrected >= 0)
    assert corrected.sum() == pytest.approx(1, abs=1e-12)


def test_a_sensor_that_shows_blur_too_strong_is_put_right() -> None:
    levels = [float(level) for level in LEVELS] * 12
    estimates = [reading(min(100, 0.6 * level + 25) if level else 0) for level in levels]
    correction = fit("camera", estimates, levels)
    before = [abs(e.level - level) for e, level in zip(estimates, levels, strict=True)]
    after = [
        abs(correction.apply(e).level - level) for e, level in zip(estimates, levels, strict=True)
    ]
    assert np.mean(after) < 0.4 * np.mean(before)


def test_too_sure_a_network_becomes_less_so() -> None:
    rng = np.random.default_rng(0)
    levels = rng.choice(LEVELS, 300).tolist()
    seen = [float(np.clip(level + rng.choice([-10, 0, 10]), 0, 100)) for level in levels]
    estimates = [reading(level, width=2.0) for level in seen]
    correction = fit("camera", estimates, levels)
    assert correction.exponent < 0.7
    assert correction.apply(reading(50, width=2.0)).std > reading(50, width=2.0).std


def test_a_file_holds_all_of_it(tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    correction = Calibration("camera", {"blur": (1.2, -3.0)}, 0.5, tuple(range(11)))
    correction.write(path)
    assert Calibration.read(path, "camera") == correction
    with pytest.raises(InputError, match="is for a camera"):
        Calibration.read(path, "radar")


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "{}",
        '{"sensor": "camera", "lines": {}, "exponent": 1, "offsets": [0]}',
        '{"sensor": "camera", "lines": {}, "exponent": 0, "offsets": [0,0,0,0,0,0,0,0,0,0,0]}',
        '{"sensor": "camera", "lines": {}, "exponent": NaN, "offsets": [0,0,0,0,0,0,0,0,0,0,0]}',
        '{"sensor": "camera", "lines": {"a": 1}, "exponent": 1, "offsets": []}',
    ],
)
def test_what_is_no_calibration_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "c.json"
    path.write_text(content)
    with pytest.raises(InputError, match="no calibration"):
        Calibration.read(path, "camera")
    with pytest.raises(InputError, match="expected a file"):
        Calibration.read(tmp_path / "none.json", "camera")


def frames(count: int) -> list[Frame]:
    image = np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8)
    return [Frame(image, "camera", index, index, "file") for index in range(count)]


def test_a_long_drive_is_thinned_out_evenly_and_a_short_one_refused() -> None:
    asked = []

    def estimate(frame: Frame) -> Estimate:
        asked.append(frame.sequence)
        return replace(reading(0.0), kind_probabilities={"clean": 1.0})

    _, worth = calibrate("camera", frames(5 * MOST_ANSWERS), lambda: estimate, 0)
    assert MOST_ANSWERS <= worth.answers <= 2 * MOST_ANSWERS
    assert len(asked) < 5 * 4 * MOST_ANSWERS
    with pytest.raises(InputError, match="too few messages; at least 12"):
        calibrate("camera", frames(3), lambda: estimate, 0)
