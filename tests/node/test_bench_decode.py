"""The decoding benchmark measures what it says: exact results, every rival, every batch size."""

from __future__ import annotations

from pathlib import Path

import pytest

from models.evaluate.report import Goal, Point
from node.bench import decode


def test_the_codec_is_measured_at_every_batch_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decode, "BATCHES", (1, decode.SCAN_FRAMES))
    results = list(decode.codec_results(decode.parsed_database(), rounds=1))
    points = [result for result in results if isinstance(result, Point)]
    assert [(point.variant, point.knob) for point in points] == [
        ("cantools", "batch=1"),
        ("codec", "batch=1"),
        ("codec", "batch=250"),
    ]
    assert all(point.error == 0 and point.run_time_us > 0 for point in points)
    assert [result.goal for result in results if isinstance(result, Goal)] == [50.0]


@pytest.mark.parametrize("quality", [False, True])
def test_all_rivals_decode_a_log_to_the_same_values(tmp_path: Path, quality: bool) -> None:
    frames = decode.simulated_log(20, quality, cycles=15)
    assert (frames.can_id == 0x201).sum() == 2
    log = tmp_path / "radar.log"
    results = list(decode.log_results(decode.parsed_database(), log, frames, "20", rounds=1))
    points = [result for result in results if isinstance(result, Point)]
    assert len(points) == 4
    assert all(point.error == 0 and point.run_time_us > 0 for point in points)


def test_a_wrong_value_would_show(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    frames = decode.simulated_log(5, True, cycles=2)
    wrong = decode.simulated_log(5, True, cycles=2)
    wrong.data[3, 2] ^= 1
    log = tmp_path / "radar.log"
    decode.write_candump(log, [frames])
    scans = decode.scans_of_log(log)
    decode.write_candump(log, [wrong])
    decoded = decode.decoded_by_python_can(log, decode.parsed_database())
    assert decode.largest_difference(scans, decoded) > 0.1
