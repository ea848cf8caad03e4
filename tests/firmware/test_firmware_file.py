"""Firmware files: names, values, groups, aliases; shipped ones are whole; a dump reads back."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.errors import InputError
from autopilot.files.strict_yaml import parse_document
from autopilot.firmware.file import (
    Heading,
    TypedValue,
    dump_firmware,
    firmware_from,
    load_firmware,
    shipped_firmware,
    wanted_parameters,
)

FILE = """\
schema_version: 2
firmware: ardurover
frame: boat
groups:
  one:
    parameters:
      FRAME_CLASS: 2
      SYSID_MYGCS: {value: 255, also_named: [MAV_GCS_SYSID], reboot: true}
"""


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("FRAME_CLASS", "Frame_CLASS", "line 7, column 7: Frame_CLASS is not a parameter's name: capital letters"),
        (
            "FRAME_CLASS",
            "FRAME_CLASS_TOO_LONG",
            "FRAME_CLASS_TOO_LONG has 20 characters, a parameter's name has at most",
        ),
        ("FRAME_CLASS", "MAV_GCS_SYSID", "MAV_GCS_SYSID is given twice, also in the group one; keep one of them."),
        ("FRAME_CLASS: 2", "FRAME_CLASS: two", "FRAME_CLASS is the text 'two', needed is a whole number, or a finite"),
        ("FRAME_CLASS: 2", "FRAME_CLASS: 1e39", "FRAME_CLASS is 1e+39, which is outside what a 32-bit float holds"),
        ("FRAME_CLASS: 2", "FRAME_CLASS: .nan", "FRAME_CLASS is nan, needed is"),
        ("value: 255", "valu: 255", "valu is not a known key; did you mean value?"),
        ("ardurover", "arducopter", "firmware is the text 'arducopter', allowed are ardurover, px4"),
        (
            "schema_version: 2",
            "schema_version: 9",
            "schema_version is 9, a firmware file of this Norrbin has 2; update Norrbin, or",
        ),
    ],
)
def test_each_mistake_is_one_sentence(old: str, new: str, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        firmware_from(parse_document(FILE.replace(old, new, 1), "fw.yaml"))
    assert sentence in str(caught.value)


def test_a_file_without_parameters_is_refused() -> None:
    text = "schema_version: 2\nfirmware: px4\nframe: boat\ngroups: {}\n"
    with pytest.raises(InputError, match="no group holds a parameter"):
        firmware_from(parse_document(text))


def test_wanted_parameters_keep_order_type_and_aliases() -> None:
    wanted = wanted_parameters(firmware_from(parse_document(FILE)))
    assert [each.names for each in wanted] == [("FRAME_CLASS",), ("SYSID_MYGCS", "MAV_GCS_SYSID")]
    assert [type(each.value) for each in wanted] == [int, int]
    assert wanted[1].reboot


@pytest.mark.parametrize("name", shipped_firmware())
def test_shipped_files_load_and_say_what_they_were_checked_with(name: str) -> None:
    firmware = load_firmware(name)
    assert firmware.checked_with
    assert firmware.source
    assert len(wanted_parameters(firmware)) > 10


def test_the_shipped_boat_steers_a_rudder_and_obeys_the_ground_station() -> None:
    values = {each.name: each.value for each in wanted_parameters(load_firmware("ardurover-boat"))}
    assert values["FRAME_CLASS"] == 2
    assert values["SERVO1_FUNCTION"] == 26
    assert values["SERVO3_FUNCTION"] == 70
    assert values["SYSID_MYGCS"] == 255


NAMES = st.from_regex(r"\A[A-Z_][A-Z0-9_]{0,15}\Z")
VALUES = st.one_of(st.integers(-(2**31), 2**32 - 1), st.floats(width=32, allow_nan=False, allow_infinity=False))


@settings(max_examples=150, deadline=None)
@given(st.dictionaries(NAMES, VALUES, min_size=1, max_size=12), st.text(max_size=20))
def test_a_dump_reads_back(values: dict[str, int | float], description: str) -> None:
    typed = [TypedValue(name, value) for name, value in values.items()]
    text = dump_firmware(typed, Heading("ardurover", "boat", description, checked_with=("ArduRover 4.6",)))
    firmware = firmware_from(parse_document(text))
    read = {each.name: each.value for each in wanted_parameters(firmware)}
    assert read == values
    assert all(struct.pack("<f", read[name]) == struct.pack("<f", values[name]) for name in values)
    assert firmware.description == description


def backup_text() -> str:
    values = [TypedValue("CRUISE_SPEED", 4.125), TypedValue("FRAME_CLASS", 2, 2), TypedValue("WP_RADIUS", 2.5)]
    values += [TypedValue("WP_SPEED", 3.25), TypedValue("BARO_NONE", float("nan"))]
    return dump_firmware(values, Heading("ardurover", "boat", is_backup=True))


def test_a_backup_that_was_cut_off_anywhere_is_refused() -> None:
    text = backup_text()
    whole = wanted_parameters(firmware_from(parse_document(text)))
    assert [(each.name, each.value) for each in whole] == [
        ("CRUISE_SPEED", 4.125),
        ("FRAME_CLASS", 2),
        ("WP_RADIUS", 2.5),
        ("WP_SPEED", 3.25),
    ]
    for length in range(len(text.rstrip())):
        with pytest.raises(InputError):
            firmware_from(parse_document(text[:length]))


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("      WP_SPEED: 3.25\n", "", "was written with 4 parameters and holds 3: it was cut off"),
        ("3.25", "3.2", "does not hold the values it was written with"),
    ],
)
def test_a_backup_that_was_changed_says_what_to_do(old: str, new: str, sentence: str) -> None:
    text = backup_text()
    assert old in text
    changed = text.replace(old, new)
    with pytest.raises(InputError, match=f"{sentence}.*take count and checksum out"):
        firmware_from(parse_document(changed))
    own = "".join(line for line in changed.splitlines(True) if not line.startswith(("count:", "checksum:")))
    assert len(wanted_parameters(firmware_from(parse_document(own)))) >= 2
