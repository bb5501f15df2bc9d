from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from dbc.errors import LogError
from drivers.can_frames import concatenate
from drivers.candump import write_candump
from models.world.radar import WorldRadar
from models.world.road import World
from node.cli import app

REAL = {"object_mode_144s": 5609, "object_mode_38s": 2996}


def decoded(log: Path, *flags: str) -> str:
    result = CliRunner().invoke(app, ["decode", str(log), *flags])
    assert result.exit_code == 0, result.exception
    return result.stdout


def test_rows_and_json_say_the_same(tmp_path: Path) -> None:
    log = tmp_path / "world.log"
    radar = WorldRadar(World(seed=2, duration_s=0.5))
    write_candump(log, radar.frames())
    scans = [json.loads(line) for line in decoded(log, "--json").splitlines()]
    rows = list(csv.DictReader(io.StringIO(decoded(log))))
    expected = list(WorldRadar(World(seed=2, duration_s=0.5)).scans())
    assert len(rows) == sum(map(len, expected))
    assert [len(scan["x"]) for scan in scans] == [len(scan) for scan in expected]
    for scan, truth in zip(scans, expected, strict=True):
        for name, array in truth.arrays().items():
            np.testing.assert_array_equal(np.array(scan[name], array.dtype), array)
    flat = [x for scan in scans for x in scan["rcs"]]
    assert [float(row["rcs"]) for row in rows] == flat


@pytest.mark.parametrize("name", REAL)
def test_real_recordings_in_object_mode(data: Path, name: str) -> None:
    lines = decoded(data / "radar" / "candump" / f"{name}.log").splitlines()
    assert len(lines) - 1 == REAL[name]


def test_radars_on_two_buses_are_told_apart(tmp_path: Path) -> None:
    log = tmp_path / "world.log"
    one, two = (
        concatenate(list(WorldRadar(World(seed=k, duration_s=0.3)).frames())) for k in (1, 2)
    )
    both = concatenate([replace(one, channels=("can0",)), replace(two, channels=("can1",))])
    write_candump(log, [both.select(np.argsort(both.stamp_ns, kind="stable"))])
    scans = [json.loads(line) for line in decoded(log, "--json").splitlines()]
    for seed, sensor in ((1, "radar_0"), (2, "can1.radar_0")):
        expected = list(WorldRadar(World(seed=seed, duration_s=0.3)).scans())
        own = [scan for scan in scans if scan["sensor"] == sensor]
        assert [len(scan["x"]) for scan in own] == [len(scan) for scan in expected]
        assert all(scan["frames_lost"] == scan["strays"] == 0 for scan in own)
    assert len(scans) == len([scan for scan in scans if "radar_0" in scan["sensor"]])


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"\x00\xff\x7fELF" * 100, "no CAN frame"),
        (b"", "holds no CAN frame"),
        (b"(1.0) can0 123#00\n", "no radar scan"),
        (b"(1532402927.664178) can0 600#7D000002\n(1532402927.66", ":2:"),
    ],
)
def test_what_is_no_radar_log_says_where(tmp_path: Path, content: bytes, expected: str) -> None:
    log = tmp_path / "bad.log"
    log.write_bytes(content)
    result = CliRunner().invoke(app, ["decode", str(log)])
    assert isinstance(result.exception, LogError)
    assert expected in str(result.exception)
    assert "\n" not in str(result.exception)


def test_what_was_lost_is_null_in_json_and_counted_on_standard_error(tmp_path: Path) -> None:
    log = tmp_path / "lossy.log"
    log.write_text(
        "(1.000000) can0 60A#02C24910\n"
        "(1.000100) can0 60B#5F5F2BCC80200193\n"
        "(1.000200) can0 60B#604F04028020019C\n"
        "(1.000300) can0 60D#5F7D0FA170800A0C\n"
        "(1.000400) can0 60D#077D0FA170800A0C\n"
        "(1.000500) can0 702#0084A33A02\n"
    )
    result = CliRunner().invoke(app, ["decode", str(log), "--json"])
    (scan,) = map(json.loads, result.stdout.splitlines())
    assert scan["length"] == [2.0, None]
    assert scan["object_class"] == [1, 7]
    assert "prob_of_exist" not in scan
    assert result.stderr == (
        f"{log}: 1 scans, 1 frames lost, 0 cycles lost, 0 duplicates, 2 strays\n"
    )
