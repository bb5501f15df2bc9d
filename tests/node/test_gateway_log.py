"""The gateway from a CAN log, to a CAN log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dbc.errors import InputError, LogError
from drivers.ars408 import ScanAssembler
from drivers.can_bus import open_bus
from drivers.can_frames import CanFrames, FrameFlag, concatenate
from drivers.candump import read_candump, write_candump
from drivers.scan import RadarScan
from node.gateway import Gateway, sensor_type_of
from node.gateway_scene import build_gateway_scene
from tests.node.gateway_stream import CYCLE_NS, SPACING_NS, merged, other_frames, radar_frames, wire

WITHIN_S = 20.0
CYCLES = 5


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def drive() -> CanFrames:
    radar = concatenate([radar_frames(number) for number in range(CYCLES)])
    others = other_frames(radar.stamp_ns[::30].tolist(), [0x008] * len(radar.stamp_ns[::30]))
    return merged(radar, others)


@pytest.fixture
def log(tmp_path: Path, drive: CanFrames) -> Path:
    path = tmp_path / "drive.log"
    write_candump(path, [drive])
    return path


def gateway(source: object, target: object, *inject: str, **flags: bool) -> Gateway:
    scene = build_gateway_scene(None, "radar", str(source), inject=inject)
    return Gateway(scene, str(target), control=False, **flags)


def read(path: Path) -> CanFrames:
    return concatenate(list(read_candump(path)))


def scans(frames: CanFrames) -> list[RadarScan]:
    items = [*(assembler := ScanAssembler({0: "radar"})).feed(frames), *assembler.flush()]
    return [item for item in items if isinstance(item, RadarScan)]


def test_a_log_is_an_output_for_a_radar() -> None:
    assert sensor_type_of("out.log") == sensor_type_of("x/out.candump.gz") == "radar"


def test_level_0_copies_a_log_byte_for_byte(log: Path, tmp_path: Path) -> None:
    with gateway(log, tmp_path / "out.log") as running:
        assert running.wait(WITHIN_S)
    assert (tmp_path / "out.log").read_bytes() == log.read_bytes()


@pytest.mark.parametrize("suffix", [".log", ".log.gz"])
def test_from_log_to_log_a_scan_is_changed_and_as_late_as_it_would_be_on_a_bus(
    log: Path, drive: CanFrames, tmp_path: Path, suffix: str
) -> None:
    out = tmp_path / f"out{suffix}"
    with gateway(log, out, "radar:missed:60") as running:
        assert running.wait(WITHIN_S)
    came, went = scans(drive), scans(read(out))
    assert [scan.meas_counter for scan in went] == [scan.meas_counter for scan in came]
    assert all(len(new) < len(old) for new, old in zip(went, came, strict=True))
    assert all(scan.frames_lost == scan.strays == 0 for scan in went)
    late_ns = np.array([new.stamp_ns - old.stamp_ns for new, old in zip(went, came, strict=True)])
    np.testing.assert_array_equal(late_ns, 80 * SPACING_NS)
    passed = read(out).can_id == 0x008
    kept = drive.can_id == 0x008
    assert wire(read(out).select(passed)) == wire(drive.select(kept))
    np.testing.assert_array_equal(read(out).stamp_ns[passed], drive.stamp_ns[kept])


def test_the_last_scan_of_a_log_is_not_cut_off(tmp_path: Path) -> None:
    whole = radar_frames(0, quality=False)
    half = radar_frames(1, quality=False).select(slice(0, 20))
    write_candump(tmp_path / "drive.log", [whole, half])
    with gateway(tmp_path / "drive.log", tmp_path / "out.log", "radar:snr:60") as running:
        assert running.wait(WITHIN_S)
    assert wire(read(tmp_path / "out.log"))[-20:] == wire(half)
    assert running.summary()["cut_off"] == 0


def test_error_frames_go_from_log_to_log(drive: CanFrames, tmp_path: Path) -> None:
    error = other_frames([int(drive.stamp_ns[-1])], [0x20])
    error.flags[:] = FrameFlag.ERROR
    write_candump(tmp_path / "drive.log", [drive, error])
    with gateway(tmp_path / "drive.log", tmp_path / "out.log") as running:
        assert running.wait(WITHIN_S)
    assert (tmp_path / "out.log").read_bytes() == (tmp_path / "drive.log").read_bytes()


def test_a_log_is_played_onto_a_bus_with_its_timing(log: Path, drive: CanFrames) -> None:
    with open_bus("virtual:from-log") as ecu:
        with gateway(log, "virtual:from-log") as running:
            assert running.wait(WITHIN_S)
        heard = ecu.read(1.0)
    assert wire(heard) == wire(drive)
    took_ns = int(heard.stamp_ns[-1] - heard.stamp_ns[0])
    assert took_ns > 0.9 * (CYCLES - 1) * CYCLE_NS


def test_a_bus_is_written_to_a_log_once_it_ends(drive: CanFrames, tmp_path: Path) -> None:
    out = tmp_path / "out.log"
    with open_bus("virtual:to-log") as radar, gateway("virtual:to-log", out) as running:
        radar.send(drive)
        while running.summary()["frames_out"] < len(drive):
            assert not running.wait(0.01)
        assert not out.exists()
    assert wire(read(out)) == wire(drive)
    assert (np.diff(read(out).stamp_ns) >= 0).all()


def test_what_cannot_be_leaves_nothing_behind(log: Path, tmp_path: Path) -> None:
    here = sorted(tmp_path.iterdir())
    with pytest.raises(LogError, match=r"missing\.log: cannot be read"):
        gateway(tmp_path / "missing.log", tmp_path / "out.log")
    with pytest.raises(InputError, match="is input and output"):
        gateway(log, log)
    with pytest.raises(LogError, match=r"nowhere/out\.log: cannot be written"):
        gateway(log, tmp_path / "nowhere" / "out.log")
    with pytest.raises(InputError, match="is a log, which only goes one way"):
        gateway(log, "virtual:x", both_ways=True)
    gateway(log, tmp_path / "out.log").stop()
    assert sorted(tmp_path.iterdir()) == here
