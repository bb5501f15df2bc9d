"""The shipped DBC file: what a radar really sent, and what every reader of DBC files needs."""

from __future__ import annotations

from pathlib import Path

import cantools.database
import pytest
from cantools.database.can import Database as ParsedDatabase

import dbc.codec
from dbc.codec import ars408

IDENTIFIERS = [0x200, 0x201, 0x202, 0x203, 0x204, 0x300, 0x301, 0x600, 0x60A, 0x60B, 0x60C]
IDENTIFIERS += [0x60D, 0x60E, 0x700, 0x701, 0x702]


@pytest.fixture(scope="module")
def parsed() -> ParsedDatabase:
    loaded = cantools.database.load_file(Path(dbc.codec.__file__).with_name("ars408.dbc"))
    assert isinstance(loaded, ParsedDatabase)
    return loaded


def _decode(parsed: ParsedDatabase, identifier: int, payload: str) -> dict[str, object]:
    decoded = parsed.decode_message(identifier, bytes.fromhex(payload))
    return {name: getattr(value, "name", value) for name, value in decoded.items()}


def test_every_message_is_there_and_strictly_valid(parsed: ParsedDatabase) -> None:
    assert sorted(message.frame_id for message in parsed.messages) == IDENTIFIERS
    for message in parsed.messages:
        message.refresh(strict=True)
        assert message.comment
        assert set(message.senders) | set(message.receivers) == {"Radar", "ECU"}
        for signal in message.signals:
            assert signal.byte_order == "big_endian"
            assert not signal.is_signed


def test_cycle_times(parsed: ParsedDatabase) -> None:
    times = {message.frame_id: message.cycle_time for message in parsed.messages}
    assert {key: value for key, value in times.items() if value} == {
        0x201: 1000,
        0x600: 72,
        0x60A: 72,
        0x700: 1000,
    }


def test_a_real_cluster_list_head_and_cluster(parsed: ParsedDatabase) -> None:
    head = _decode(parsed, 0x600, "5024581110")
    assert head == {
        "Cluster_NofClustersNear": 80,
        "Cluster_NofClustersFar": 36,
        "Cluster_MeasCounter": 0x5811,
        "Cluster_InterfaceVersion": 1,
    }
    cluster = _decode(parsed, 0x701, "004E81FC80200147")
    assert cluster["Cluster_DistLong"] == pytest.approx(2.4)
    assert cluster["Cluster_DistLat"] == pytest.approx(-0.7)
    assert cluster["Cluster_VrelLong"] == 0
    assert cluster["Cluster_VrelLat"] == 0
    assert cluster["Cluster_DynProp"] == "stationary"
    assert cluster["Cluster_RCS"] == -28.5


def test_a_real_radar_state(parsed: ParsedDatabase) -> None:
    state = _decode(parsed, 0x201, "401F400010340000")
    assert state.pop("RadarState_NVMReadStatus") == 1
    assert state.pop("RadarState_MaxDistanceCfg") == 250
    assert state.pop("RadarState_OutputTypeCfg") == "objects"
    assert state.pop("RadarState_SendQualityCfg") == 1
    assert state.pop("RadarState_SendExtInfoCfg") == 1
    assert state.pop("RadarState_SortIndex") == 1
    assert state.pop("RadarState_MotionRxState") == "ok"
    assert state.pop("RadarState_RadarPowerCfg") == "standard"
    assert state.pop("RadarState_RCS_Threshold") == "standard"
    assert set(state.values()) == {0}


def test_a_real_object(parsed: ParsedDatabase) -> None:
    general = _decode(parsed, 0x60B, "5F5F2BCC80200193")
    assert general["Obj_ID"] == 0x5F
    assert general["Obj_DistLong"] == pytest.approx(109.0)
    assert general["Obj_DistLat"] == pytest.approx(-10.2)
    quality = _decode(parsed, 0x60C, "5F8CE33A0220E8")
    assert quality["Obj_DistLong_rms"] == "0.371 m"
    assert quality["Obj_ProbOfExist"] == 7
    extended = _decode(parsed, 0x60D, "5F7D0FA170800A0C")
    assert extended["Obj_OrientationAngle"] == pytest.approx(0.4 * (0x70 << 2 | 2) - 180)
    assert extended["Obj_Length"] == 2.0
    assert extended["Obj_Width"] == pytest.approx(2.4)


def test_filters_are_multiplexed_by_their_index(parsed: ParsedDatabase) -> None:
    for identifier, prefix in ((0x202, "FilterCfg_"), (0x204, "FilterState_")):
        message = parsed.get_message_by_frame_id(identifier)
        (tree,) = (branch for branch in message.signal_tree if isinstance(branch, dict))
        criteria = message.get_signal_by_name(prefix + "Index").choices
        assert criteria is not None
        assert tree[prefix + "Index"] == {
            index: [f"{prefix}Min_{name}", f"{prefix}Max_{name}"]
            for index, name in criteria.items()
        }
        assert list(criteria) == list(range(15))
        values = {
            prefix + "Type": "object",
            prefix + "Index": "X",
            prefix + "Active": 1,
            prefix + "Valid": 1,
            prefix + "Min_X": 10.0,
            prefix + "Max_X": 120.2,
        }
        payload = message.encode(values)
        assert payload.hex() == f"d6{round(510 / 0.2):04x}{round(620.2 / 0.2):04x}"
        assert message.decode(payload)[prefix + "Max_X"] == pytest.approx(120.2)


def test_rms_value_tables_follow_their_law(parsed: ParsedDatabase) -> None:
    tables = [
        (signal.unit, signal.choices)
        for message in parsed.messages
        for signal in message.signals
        if signal.name.endswith("_rms") and signal.choices
    ]
    assert len(tables) == 8
    for _, choices in tables:
        values = [float(str(choices[index]).split()[0]) for index in range(31)]
        assert values == [round(0.005 * 2000 ** (index / 30), 3) for index in range(31)]
        assert str(choices[31]) == "invalid"


def test_every_message_but_the_filters_compiles() -> None:
    for identifier in set(IDENTIFIERS) - {0x202, 0x204}:
        codec = ars408().message(identifier)
        assert codec.id == identifier
        assert codec.length <= 8
