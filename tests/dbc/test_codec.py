"""The codec against cantools, for any message that hypothesis can draw."""

from __future__ import annotations

import math
from pathlib import Path

import cantools.database
import numpy as np
import pytest
from cantools.database.can import Database as ParsedDatabase
from cantools.database.can import Message, Signal
from cantools.database.conversion import BaseConversion
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from dbc.codec import Database, MessageCodec, ars408, load_database
from dbc.errors import DatabaseError, InputError

LENGTHS = [1, 2, 3, 5, 7, 8, 12, 16, 20, 24, 32, 48, 64]
scales = st.one_of(
    st.sampled_from([1, 2, -3, 5, 1000, 1.0, 2.0, 0.5, 0.2, 0.025, 0.0315, -0.1, 1e-6]),
    st.floats(1e-9, 1e9).map(lambda value: float(f"{value:.6g}")),
)
offsets = st.one_of(
    st.sampled_from([0, 1, -40, 2**40, 0.0, -500.0, -102.3, -327.68]),
    st.floats(-1e9, 1e9).map(lambda value: float(f"{value:.6g}")),
)


def _bits(order: str, start: int, length: int) -> list[int]:
    """Return the bits that a signal covers, numbered as a DBC file does."""
    if order == "little_endian":
        return list(range(start, start + length))
    first = 8 * (start // 8) + 7 - start % 8
    return [8 * (bit // 8) + 7 - bit % 8 for bit in range(first, first + length)]


@st.composite
def messages(draw: st.DrawFn) -> Message:
    size = draw(st.sampled_from(LENGTHS))
    free = set(range(8 * size))
    signals = []
    for index in range(draw(st.integers(1, 8))):
        order = draw(st.sampled_from(["little_endian", "big_endian"]))
        is_float = draw(st.integers(0, 9)) == 0
        length = draw(st.sampled_from([32, 64]) if is_float else st.integers(1, 64))
        bits = _bits(order, draw(st.integers(0, 8 * size - 1)), length)
        if not free.issuperset(bits):
            continue
        free.difference_update(bits)
        scale, offset = draw(st.just((1, 0)) | st.tuples(scales, offsets))
        conversion = BaseConversion.factory(scale, offset, is_float=is_float)
        signed = draw(st.booleans()) and not is_float
        signals.append(
            Signal(
                f"S{index}",
                bits[0],
                length,
                byte_order=order,
                is_signed=signed,
                conversion=conversion,
            )
        )
    assume(signals)
    return Message(0x123, "Drawn", size, signals)


def _payloads(draw: st.DrawFn, length: int) -> np.ndarray:
    """Draw a few payloads of hypothesis' choice and one full of noise."""
    rows = draw(st.lists(st.binary(min_size=length, max_size=length), max_size=4))
    rows.append(np.random.default_rng(draw(st.integers(0, 2**32))).bytes(length))
    return np.frombuffer(b"".join(rows), np.uint8).reshape(-1, length)


def _through_file(message: Message, folder: Path) -> tuple[MessageCodec, Message]:
    text = ParsedDatabase([message]).as_dbc_string()
    path = folder / "drawn.dbc"
    path.write_text(text)
    oracle = cantools.database.load_string(text, "dbc").get_message_by_name("Drawn")
    return load_database(path).message("Drawn"), oracle


def _same(ours: object, theirs: object) -> bool:
    if isinstance(theirs, float) and math.isnan(theirs):
        return isinstance(ours, float) and math.isnan(ours)
    return ours == theirs


@given(st.data())
@settings(
    max_examples=100,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
def test_any_message_decodes_as_cantools_does(tmp_path: Path, data: st.DataObject) -> None:
    codec, oracle = _through_file(data.draw(messages()), tmp_path)
    payloads = data.draw(st.composite(_payloads)(codec.length))
    decoded, raw = codec.decode(payloads), codec.decode_raw(payloads)
    assert set(decoded) == set(raw) == {signal.name for signal in oracle.signals}
    for row, payload in enumerate(payloads):
        expected = oracle.decode(payload.tobytes(), decode_choices=False)
        expected_raw = oracle.decode(payload.tobytes(), decode_choices=False, scaling=False)
        for name, value in expected.items():
            ours = decoded[name][row].item()
            signal = oracle.get_signal_by_name(name)
            wide = signal.length > 53 or isinstance(value, int)
            if wide and decoded[name].dtype == np.float64 and not signal.is_float:
                # cantools keeps integers of any size until the end, we a float64
                size = abs(value) + 2 * abs(signal.offset)
                assert ours == pytest.approx(value, abs=2.0**-51 * size)
            else:
                assert _same(ours, value)
            assert _same(raw[name][row].item(), expected_raw[name])


@given(st.data())
@settings(
    max_examples=100,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
def test_any_message_encodes_as_cantools_does(tmp_path: Path, data: st.DataObject) -> None:
    codec, oracle = _through_file(data.draw(messages()), tmp_path)
    payloads = data.draw(st.composite(_payloads)(codec.length))
    covered = np.zeros(8 * codec.length, bool)
    for signal in oracle.signals:
        covered[_bits(signal.byte_order, signal.start, signal.length)] = True
    mask = np.packbits(covered.reshape(-1, 8)[:, ::-1], axis=1)[:, 0]
    assume(not any(np.isnan(column).any() for column in codec.decode(payloads).values()))
    np.testing.assert_array_equal(codec.encode_raw(codec.decode_raw(payloads)), payloads & mask)
    for payload in payloads:
        values = oracle.decode(payload.tobytes(), decode_choices=False)
        ours = {name: column[0].item() for name, column in codec.decode(payload[None]).items()}
        if any(ours[name] != value for name, value in values.items()):
            continue  # over 53 bits: see above
        try:
            expected = oracle.encode(values)
        except (cantools.database.EncodeError, OverflowError):
            with pytest.raises(InputError):  # the physical value was rounded out of range
                codec.encode(ours)
        else:
            assert codec.encode(ours).tobytes() == expected


def test_a_value_is_rounded_to_the_nearest_raw_value() -> None:
    codec = ars408().message("SpeedInformation")
    values = {"RadarDevice_SpeedDirection": 1, "RadarDevice_Speed": [0.0, 0.009, 0.011, 12.349]}
    decoded = codec.decode(codec.encode(values))
    np.testing.assert_allclose(decoded["RadarDevice_Speed"], [0.0, 0.0, 0.02, 12.34])
    assert decoded["RadarDevice_SpeedDirection"].tolist() == [1, 1, 1, 1]


@pytest.mark.parametrize("speed", [163.83, -0.011, math.nan, math.inf, -1e300])
def test_a_value_out_of_range_names_its_signal(speed: float) -> None:
    codec = ars408().message("SpeedInformation")
    with pytest.raises(InputError, match=r"SpeedInformation\.RadarDevice_Speed: .*0.*163\.82"):
        codec.encode({"RadarDevice_SpeedDirection": 1, "RadarDevice_Speed": speed})


def test_a_value_one_step_too_large_is_refused() -> None:
    codec = ars408().message("RadarState")
    values = dict.fromkeys(codec.signals, 0.0)
    payload = codec.encode(values | {"RadarState_MaxDistanceCfg": 2046.0})
    assert codec.decode(payload)["RadarState_MaxDistanceCfg"].tolist() == [2046]
    for column in (2048.0, 2048):
        with pytest.raises(InputError, match=r"MaxDistanceCfg: 2048 is out of range; 0 to 2046"):
            codec.encode(values | {"RadarState_MaxDistanceCfg": column})


@pytest.mark.parametrize("bits", [1, 20, 53])
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize(("scale", "offset"), [(1, 0), (-2, 3), (2, -5), (-2.5, 0.5)])
def test_what_no_signal_holds_is_refused_whatever_its_type(
    bits: int, signed: bool, scale: float, offset: float
) -> None:
    conversion = BaseConversion.factory(scale, offset)
    signal = Signal("S", 0, bits, is_signed=signed, conversion=conversion)
    codec = MessageCodec(Message(1, "M", 8, [signal]))
    for value in (np.uint64(2**64 - 1), np.int64(-(2**63)), 2**64 - 1, 1e300, -1e300):
        for encode in (codec.encode, codec.encode_raw):
            with pytest.raises(InputError, match=r"M\.S: .* is out of range"):
                encode({"S": value})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"RadarDevice_Speed": 1.0}, "SpeedDirection: has no value"),
        (
            {"RadarDevice_Speed": 1, "RadarDevice_SpeedDirection": 1, "Speed": 1},
            "Speed: is not a signal",
        ),
        ({"RadarDevice_Speed": "fast", "RadarDevice_SpeedDirection": 1}, "not a column of numbers"),
        ({"RadarDevice_Speed": [1, 2], "RadarDevice_SpeedDirection": [1, 1, 2]}, "expected one N"),
    ],
)
def test_bad_columns_are_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ars408().message("SpeedInformation").encode(values)  # type: ignore[arg-type]


def test_no_payload_decodes_to_empty_columns() -> None:
    decoded = ars408().message("Cluster_1_General").decode(np.empty((0, 8), np.uint8))
    assert {column.shape for column in decoded.values()} == {(0,)}
    assert decoded["Cluster_ID"].dtype == np.int64
    assert decoded["Cluster_DistLong"].dtype == np.float64


def test_short_payloads_are_refused_and_long_ones_cut() -> None:
    codec = ars408().message("Obj_2_Quality")
    with pytest.raises(InputError, match="Obj_2_Quality: payloads 3x6; expected N x 7"):
        codec.decode(np.zeros((3, 6), np.uint8))
    payloads = np.random.default_rng(0).integers(0, 256, (3, 64), dtype=np.uint8)
    for name, column in codec.decode(payloads[:, :7]).items():
        np.testing.assert_array_equal(codec.decode(payloads)[name], column)


def test_extended_identifiers_are_told_from_standard_ones() -> None:
    parsed = ParsedDatabase(
        [Message(0x123, "Short", 1, []), Message(0x123, "Long", 2, [], is_extended_frame=True)]
    )
    database = Database(parsed)
    assert database.message(0x123).name == "Short"
    assert database.message(0x123 | 1 << 31).name == "Long"


@pytest.mark.parametrize("name", ["FilterCfg", "FilterState"])
def test_multiplexed_messages_are_refused(name: str) -> None:
    with pytest.raises(DatabaseError, match=f"{name}: is multiplexed"):
        ars408().message(name)


@pytest.mark.parametrize(
    ("signal", "message"),
    [
        (Signal("Early", -7, 1, byte_order="big_endian"), "starts at bit -7"),
        (Signal("Wide", 0, 65), "has 65 bits"),
        (Signal("Flat", 0, 8, conversion=BaseConversion.factory(0, 1)), "has scale 0"),
        (Signal("Huge", 0, 8, conversion=BaseConversion.factory(10**400, 0)), "has scale 1000"),
        (
            Signal("Odd", 0, 24, conversion=BaseConversion.factory(is_float=True)),
            "is a 24-bit float",
        ),
    ],
)
def test_signals_beyond_the_plan_are_refused(signal: Signal, message: str) -> None:
    with pytest.raises(DatabaseError, match=message):
        MessageCodec(Message(0x1, "M", 16, [signal]))


def test_an_unknown_message_is_refused_with_the_file_and_the_name() -> None:
    with pytest.raises(DatabaseError, match=r"ars408\.dbc: has no message 0x123"):
        ars408().message(0x123)
    with pytest.raises(DatabaseError, match=r"ars408\.dbc: has no message Nobody"):
        ars408().message("Nobody")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x00\xff\x81" * 100,
        b'VERSION ""\nBO_ 512 A 8 X\n',
        b'VERSION ""\nBU_: A\n',
        b'VERSION ""\nBO_ 512 A: 1 X\n SG_ S : 7|9@0+ (1,0) [0|1] "" X\n',
        b'VERSION ""\nBO_ 512 A: 1 X\nBO_ 5120000 A: 1 X\n',
    ],
)
def test_what_is_not_a_dbc_file_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bad.dbc"
    path.write_bytes(content)
    with pytest.raises(DatabaseError, match=r"bad\.dbc: ") as caught:
        load_database(path)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatabaseError, match="No such file"):
        load_database(tmp_path / "none.dbc")
    with pytest.raises(DatabaseError, match="Is a directory"):
        load_database(tmp_path)


def test_latin_and_utf8_files_both_load(tmp_path: Path) -> None:
    text = 'VERSION ""\nBU_: A\nBO_ 512 M: 1 A\n SG_ S : 7|8@0+ (1,0) [0|1] "°" A\n'
    for encoding in ("cp1252", "utf-8"):
        path = tmp_path / f"{encoding}.dbc"
        path.write_text(text, encoding=encoding)
        assert load_database(path).message(512).signals == ("S",)
