from __future__ import annotations

import itertools
import json
import sys
import threading
import time
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import cantools.database
import numpy as np
import pytest

from dbc.errors import DeviceError, InputError, SceneError
from drivers.can_bus import open_bus
from drivers.can_frames import CanFrames
from drivers.radar_settings import RadarFilter
from node import cli, radar_config
from node.radar_config import RadarLink

_numbers = itertools.count()
DBC = cantools.database.load_string(
    files("dbc").joinpath("ars408.dbc").read_text(encoding="utf-8"), database_format="dbc"
)
BY_CONFIG = {
    "OutputType": "OutputTypeCfg",
    "SendQuality": "SendQualityCfg",
    "SendExtInfo": "SendExtInfoCfg",
    "MaxDistance": "MaxDistanceCfg",
    "RadarPower": "RadarPowerCfg",
    "SortIndex": "SortIndex",
    "RCS_Threshold": "RCS_Threshold",
}


def frame(can_id: int, payload: bytes) -> CanFrames:
    return CanFrames(
        stamp_ns=np.zeros(1, np.int64),
        can_id=np.array([can_id], np.uint32),
        length=np.array([len(payload)], np.uint8),
        data=np.frombuffer(payload.ljust(8, b"\0"), np.uint8)[None],
        flags=np.zeros(1, np.uint8),
        channel=np.zeros(1, np.uint8),
    )


class SimulatedRadar(threading.Thread):
    """A radar that obeys, by cantools: tells its state 50 times a second and answers filters."""

    def __init__(self, spec: str, sensor_id: int = 0) -> None:
        super().__init__(daemon=True)
        self.bus = open_bus(spec)
        self.shift = 0x10 * sensor_id
        self.state = {signal.name: 0 for signal in DBC.get_message_by_name("RadarState").signals}
        self.state["RadarState_SensorID"] = sensor_id
        self.state["RadarState_OutputTypeCfg"] = 1
        self.deaf_to = 0
        self.stubborn: set[str] = set()
        self.sends_version = True
        self.stored = 0
        self.heard: list[int] = []
        self.done = threading.Event()

    def run(self) -> None:
        while not self.done.is_set():
            frames = self.bus.read(0.02)
            for can_id, length, data in zip(
                frames.can_id.tolist(), frames.length.tolist(), frames.data, strict=True
            ):
                self.hear(can_id - self.shift, data[:length].tobytes())
            self.tell(0x201, DBC.encode_message("RadarState", self.state))
            if self.sends_version:
                version = dict.fromkeys(
                    ("Version_ExtendedRange", "Version_CountryCode", "Version_PatchLevel"), 0
                )
                version |= {"Version_MajorRelease": 4, "Version_MinorRelease": 30}
                self.tell(0x700, DBC.encode_message("VersionID", version))
        self.bus.close()

    def tell(self, can_id: int, payload: bytes) -> None:
        self.bus.send(frame(can_id + self.shift, payload))

    def hear(self, can_id: int, payload: bytes) -> None:
        self.heard.append(can_id)
        if self.deaf_to:
            self.deaf_to -= 1
            return
        if can_id == 0x200:
            asked = DBC.decode_message("RadarConfig", payload, decode_choices=False)
            for config, state in BY_CONFIG.items():
                if asked[f"RadarCfg_{config}_valid"] and config not in self.stubborn:
                    self.state[f"RadarState_{state}"] = asked[f"RadarCfg_{config}"]
            if asked["RadarCfg_StoreInNVM_valid"] and asked["RadarCfg_StoreInNVM"]:
                self.stored += 1
                self.state["RadarState_NVMwriteStatus"] = int("NVM" not in self.stubborn)
        if can_id == 0x202 and "Filter" not in self.stubborn:
            self.tell(0x203, bytes([1 << 3, 0]))
            said = bytearray(payload[:5])
            said[0] &= 0b11111101
            if "Distance" in self.stubborn:
                said[4] ^= 1
            self.tell(0x204, bytes(said))


@pytest.fixture
def radar(monkeypatch: pytest.MonkeyPatch) -> Iterator[SimulatedRadar]:
    monkeypatch.setattr(radar_config, "_RESEND_S", 0.2)
    simulated = SimulatedRadar(f"virtual:radar{next(_numbers)}", sensor_id=2)
    simulated.start()
    yield simulated
    simulated.done.set()
    simulated.join(5)


EVERYTHING = {
    "output": 2.0,
    "quality": 1.0,
    "extended": 0.0,
    "max-distance": 180.0,
    "power": 3.0,
    "sort-index": 1.0,
    "rcs-threshold": 1.0,
}


def test_the_status_is_what_the_radar_says(radar: SimulatedRadar) -> None:
    with RadarLink(radar.bus.name, 2) as link:
        said = link.status(5.0)
    assert said.state["SensorID"] == 2
    assert said.state["OutputTypeCfg"] == 1
    assert said.version is not None
    assert (said.version["MajorRelease"], said.version["MinorRelease"]) == (4, 30)


def test_a_radar_without_a_version_has_a_status_all_the_same(radar: SimulatedRadar) -> None:
    radar.sends_version = False
    with RadarLink(radar.bus.name, 2) as link:
        time.sleep(0.1)
        list(link._heard(0.05))
        assert link.status(0.3).version is None


def test_every_setting_is_taken_over(radar: SimulatedRadar) -> None:
    with RadarLink(radar.bus.name, 2) as link:
        link.configure(EVERYTHING, [RadarFilter.parse("Distance:0.5:80")])
    said = {name.partition("_")[2]: value for name, value in radar.state.items()}
    assert [said[state] for state in BY_CONFIG.values()] == [2, 1, 0, 180, 3, 1, 1]
    assert radar.stored == 0


def test_what_is_not_asked_for_stays(radar: SimulatedRadar) -> None:
    radar.state["RadarState_MaxDistanceCfg"] = 196
    with RadarLink(radar.bus.name, 2) as link:
        link.configure({"quality": 1.0})
    assert radar.state["RadarState_MaxDistanceCfg"] == 196
    assert radar.state["RadarState_OutputTypeCfg"] == 1


def test_an_order_that_is_not_heard_is_repeated(radar: SimulatedRadar) -> None:
    radar.deaf_to = 3
    with RadarLink(radar.bus.name, 2) as link:
        link.configure({"output": 2.0}, [RadarFilter.parse("RCS:-10:20")])
    assert radar.heard.count(0x200) >= 2
    assert radar.state["RadarState_OutputTypeCfg"] == 2


def test_a_setting_that_the_radar_keeps_is_named(radar: SimulatedRadar) -> None:
    radar.stubborn = {"OutputType", "MaxDistance"}
    with (
        RadarLink(radar.bus.name, 2) as link,
        pytest.raises(DeviceError, match="refused") as caught,
    ):
        link.configure(EVERYTHING, timeout_s=0.5)
    assert "output is objects, not clusters" in caught.value.what
    assert "max-distance is 0, not 180" in caught.value.what
    assert "quality" not in caught.value.what


@pytest.mark.parametrize(
    ("stubborn", "said"), [("Filter", "is not confirmed"), ("Distance", "has other values")]
)
def test_a_filter_that_the_radar_keeps_is_named(
    radar: SimulatedRadar, stubborn: str, said: str
) -> None:
    radar.stubborn = {stubborn}
    with (
        RadarLink(radar.bus.name, 2) as link,
        pytest.raises(DeviceError, match=f"filter Distance {said}"),
    ):
        link.configure({}, [RadarFilter.parse("Distance:0:80")], timeout_s=0.5)


def test_a_radar_that_is_not_there_never_answers(radar: SimulatedRadar) -> None:
    with RadarLink(radar.bus.name, 5) as link:
        with pytest.raises(DeviceError, match=r"radar 5 on virtual:.* never answered"):
            link.status(0.2)
        with pytest.raises(DeviceError, match="never answered"):
            link.configure({"quality": 1.0}, timeout_s=0.2)


def test_settings_are_stored_once_and_only_if_asked(radar: SimulatedRadar) -> None:
    with RadarLink(radar.bus.name, 2) as link:
        link.configure({"output": 2.0}, store=True)
        assert radar.stored == 1
        radar.stubborn = {"NVM"}
        with pytest.raises(DeviceError, match="did not store"):
            link.configure({"output": 2.0}, store=True, timeout_s=0.5)
    assert radar.stored == 2


def test_what_cannot_be_is_refused_before_anything_is_sent(radar: SimulatedRadar) -> None:
    with RadarLink(radar.bus.name, 2) as link, pytest.raises(InputError, match="out of range"):
        link.configure({"max-distance": 5000.0})
    assert radar.heard == []


@pytest.mark.parametrize(
    "text",
    ["Distance", "Distance:1", "Distance:a:b", "Nonsense:0:1", "car:Distance:0:1",
     "Distance:0:9999", "Distance:-1:5", "Distance:9:1", "Distance:nan:1"],
)  # fmt: skip
def test_an_impossible_filter_is_refused(text: str) -> None:
    with pytest.raises(SceneError, match="--filter"):
        RadarFilter.parse(text)


@pytest.mark.parametrize("text", ["Azimuth:-30:30", "object:X:-100:100.4", "object:Y:-5:5"])
def test_a_filter_means_to_cantools_what_was_asked(text: str) -> None:
    wanted = RadarFilter.parse(text)
    said = DBC.decode_message("FilterCfg", wanted.payload(), decode_choices=True)
    assert str(said["FilterCfg_Index"]) == wanted.name
    assert str(said["FilterCfg_Type"]) == wanted.type
    assert said["FilterCfg_Active"] == said["FilterCfg_Valid"] == 1
    assert float(said[f"FilterCfg_Min_{wanted.name}"]) == pytest.approx(wanted.low, abs=0.11)
    assert float(said[f"FilterCfg_Max_{wanted.name}"]) == pytest.approx(wanted.high, abs=0.11)
    assert len(wanted.payload()) == 8


def murk(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["murk", *arguments])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


def test_the_commands(
    radar: SimulatedRadar, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    where = [radar.bus.name, "--sensor-id", "2"]
    flags = ["--output", "clusters", "--quality", "--max-distance", "200", "--power", "-6dB"]
    flags += ["--filter", "Distance:0:80", "--store", "--json"]
    assert murk(monkeypatch, "radar", "configure", *where, *flags) == 0
    captured = capsys.readouterr()
    record = json.loads(captured.out)
    assert record["settings"] == {
        "output": 2.0, "quality": 1.0, "max-distance": 200.0, "power": 2.0,
    }  # fmt: skip
    assert record["stored"] is True
    assert "wears out" in captured.err
    assert murk(monkeypatch, "radar", "status", *where, "--json") == 0
    state = json.loads(capsys.readouterr().out)["state"]
    assert (state["OutputTypeCfg"], state["MaxDistanceCfg"], state["RadarPowerCfg"]) == (2, 200, 2)
    assert murk(monkeypatch, "radar", "status", *where) == 0
    said = capsys.readouterr().out
    assert "clusters" in said
    assert "200 m" in said
    assert "4.30.0" in said


@pytest.mark.parametrize(
    "flags",
    [
        [],
        ["--output", "everything"],
        ["--filter", "x"],
        ["--max-distance", "9999"],
        ["--sort", "9"],
    ],
)
def test_wrong_flags_end_with_two(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], flags: list[str]
) -> None:
    spec = f"virtual:flags{next(_numbers)}"
    assert murk(monkeypatch, "radar", "configure", spec, *flags, "--timeout", "0.1") == 2
    assert capsys.readouterr().out == ""


def test_a_scene_sets_its_radars_up(
    radar: SimulatedRadar, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = tmp_path / "scene.toml"
    settings = 'output = "clusters"\nquality = true\nfilters = ["Distance:0:90"]'
    path.write_text(
        "[[sensors]]\nname = 'front'\ntype = 'radar'\n"
        f"source = '{radar.bus.name}'\nsensor_id = 2\n[sensors.settings]\n{settings}\n"
    )
    assert murk(monkeypatch, "radar", "configure", str(path)) == 0
    assert radar.state["RadarState_OutputTypeCfg"] == 2
    assert radar.state["RadarState_SendQualityCfg"] == 1
    assert radar.stored == 0
