"""Ground stations' parameter files: read strictly, written so that every bit survives the way there and back."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.mavparm import MAVParmDict

from autopilot.errors import InputError
from autopilot.files.strict_yaml import parse_document
from autopilot.firmware.file import Heading, TypedValue, dump_firmware, firmware_from, wanted_parameters
from autopilot.firmware.foreign_files import dump_foreign, float_text, is_foreign, parse_foreign, read_foreign

MISSION_PLANNER = "#NOTE: 21/11/2026 my boat\nACRO_TURN_RATE,180\nCRUISE_SPEED,4.6\nLOG_BITMASK,0xFFFF\n"
MAVPROXY = "CRUISE_SPEED     4.600000\n# a comment\nSERVO1_FUNCTION  26 # rudder\n\n"
QGC = (
    "# Onboard parameters for Vehicle 1\n#\n# Stack: PX4 Pro\n# Vehicle: Rover\n# Version: 1.16.0 \n#\n"
    "# Vehicle-Id Component-Id Name Value Type\n"
    "1\t1\tCA_AIRFRAME\t5\t6\n1\t1\tRA_WHEEL_BASE\t0.500000000000000000\t9\n1\t154\tMNT_MODE_IN\t-1\t6\n"
)


def test_what_each_ground_station_writes_is_understood() -> None:
    planner = parse_foreign(MISSION_PLANNER, "boat.param")
    assert [tuple(each[:2]) for each in planner.values] == [
        ("ACRO_TURN_RATE", 180),
        ("CRUISE_SPEED", 4.6),
        ("LOG_BITMASK", 65535),
    ]
    proxy = parse_foreign(MAVPROXY, "boat.parm")
    assert [tuple(each[:2]) for each in proxy.values] == [("CRUISE_SPEED", 4.6), ("SERVO1_FUNCTION", 26)]
    station = parse_foreign(QGC, "boat.params")
    assert station.values == [TypedValue("CA_AIRFRAME", 5, 6), TypedValue("RA_WHEEL_BASE", 0.5, 9)]
    assert (station.firmware, station.system, station.left_out) == ("px4", 1, 1)


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("a.param", "A,1,2\n", "a.param, line 1: 'A,1,2' has 3 fields; allowed is NAME,VALUE or NAME VALUE."),
        ("a.parm", "\nSPEED fast\n", "a.parm, line 2: 'fast' is not a number that a 32-bit float holds."),
        ("a.parm", "A nan\n", "a.parm, line 1: 'nan' is not a number"),
        ("a.parm", "A 1e39\n", "a.parm, line 1: '1e39' is not a number that a 32-bit float holds"),
        ("a.param", "A,1\nB,1\nA,2\n", "a.param, line 3: A is given twice, first on line 1; keep one."),
        ("a.param", "speed,1\n", "a.param, line 1: 'speed' is not a parameter's name: at most 16 capital letters"),
        ("a.param", "A2345678901234567,1\n", "is not a parameter's name"),
        ("a.parm", "@include base.parm\n", "a.parm, line 1: @include is not followed; put the lines of that file here"),
        ("a.parm", "# nothing\n", "a.parm: holds no parameter; a line is NAME,VALUE."),
        ("a.params", "1\t1\tA\t1\n", "a.params, line 1: '1 1 A 1' has 4 fields; allowed are five with tabs"),
        ("a.params", "1\tx\tA\t1\t6\n", "a.params, line 1: the ids and the type are whole numbers"),
        ("a.params", "1\t1\tA\t1\t8\n", "a.params, line 1: the type 8 cannot be used; allowed are 1 to 6"),
        ("a.params", "1\t1\tA\t300\t2\n", "a.params, line 1: A is 300, which its type INT8 cannot hold."),
        ("a.params", "1\t1\tA\t1.5\t6\n", "a.params, line 1: A is 1.5, which its type INT32 cannot hold."),
        ("a.params", "1\t1\tA\t1\t6\n2\t1\tB\t1\t6\n", "a.params: holds parameters of several vehicles (1, 2)"),
    ],
)
def test_each_mistake_is_one_sentence(name: str, text: str, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_foreign(text, name)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.parm: no such file"):
        read_foreign(tmp_path / "none.parm")
    latin = tmp_path / "latin.parm"
    latin.write_bytes(b"A 1\n# b\xe5t\n")
    with pytest.raises(InputError, match=r"latin\.parm, line 2: byte 7 is not UTF-8 text"):
        read_foreign(latin)
    assert is_foreign("X.PARAM")
    assert not is_foreign("x.yaml")


def bits(value: float) -> bytes:
    return struct.pack("<f", value)


NAMES = st.from_regex(r"\A[A-Z_][A-Z0-9_]{0,15}\Z")
FLOATS = st.floats(width=32, allow_nan=False, allow_infinity=False)
TYPED = st.one_of(
    st.tuples(FLOATS, st.just(9)),
    st.tuples(st.integers(-128, 127), st.just(2)),
    st.tuples(st.integers(-32768, 32767), st.just(4)),
    st.tuples(st.integers(-(2**31), 2**31 - 1), st.just(6)),
)
TABLES = st.dictionaries(NAMES, TYPED, min_size=1, max_size=8)


@settings(max_examples=100, deadline=None)
@given(TABLES)
def test_types_and_bits_survive_qgroundcontrol_and_yaml(table: dict[str, tuple[float, int]]) -> None:
    values = [TypedValue(name, value, kind) for name, (value, kind) in sorted(table.items())]
    heading = Heading("px4", "boat", date="2026-11-21")
    back = parse_foreign(dump_foreign("x.params", values, heading), "x.params").values
    assert [(each.name, each.kind, bits(each.value)) for each in back] == [
        (each.name, each.kind, bits(each.value)) for each in values
    ]
    firmware = firmware_from(parse_document(dump_firmware(values, heading)))
    assert {each.name: bits(each.value) for each in wanted_parameters(firmware)} == {
        each.name: bits(each.value) for each in values
    }


@settings(max_examples=60, deadline=None)
@given(TABLES, st.sampled_from(["x.param", "x.parm"]))
def test_pymavlink_reads_our_files_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, table: dict[str, tuple[float, int]], name: str
) -> None:
    values = [TypedValue(key, value, kind) for key, (value, kind) in table.items()]
    path = tmp_path_factory.getbasetemp() / name
    path.write_text(dump_foreign(path, values, Heading("ardurover", "boat")))
    peer = MAVParmDict()
    assert peer.load(str(path), use_excludes=False)
    assert {key: bits(value) for key, value in peer.items()} == {each.name: bits(each.value) for each in values}


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(NAMES, st.floats(-1.0e6, 1.0e6, width=32), min_size=1, max_size=8))
def test_we_read_what_pymavlink_writes(tmp_path_factory: pytest.TempPathFactory, table: dict[str, float]) -> None:
    peer = MAVParmDict()
    peer.update(table)
    path = tmp_path_factory.getbasetemp() / "peer.parm"
    peer.save(str(path))
    read = {each.name: each.value for each in read_foreign(path).values}
    assert read.keys() == table.keys()
    assert all(abs(read[name] - value) <= 5.1e-7 for name, value in table.items())  # it writes six decimals


def test_floats_are_written_short() -> None:
    assert float_text(struct.unpack("<f", struct.pack("<f", 0.1))[0]) == "0.1"
    assert float_text(180.0) == "180.0"
    assert float_text(7) == "7"
    assert float_text(-0.0) == "-0.0"


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=60), st.sampled_from(["x.param", "x.parm", "x.params"]))
def test_no_text_raises_anything_but_input_error(text: str, name: str) -> None:
    try:
        parse_foreign(text, name)
    except InputError as error:
        assert "\n" not in str(error)
