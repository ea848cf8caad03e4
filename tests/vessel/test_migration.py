"""Files of an older schema are read as the newest has them; unknown versions are refused with what to do."""

from __future__ import annotations

import pytest

from autopilot.errors import InputError
from autopilot.files.strict_yaml import FIRMWARE_STEPS, VESSEL_STEPS, migrated, newest, parse_document
from autopilot.firmware.file import firmware_from, wanted_parameters
from autopilot.vessel.file import parse_vessel

OLD_VESSEL = """\
schema_version: 1
name: Boat
model: {K_1_s: 0.7, T_s: 0.3, reference_speed_m_s: 4.6, source: "identified from a.csv, b.tlog"}
rudder: {angle_max_deg: 30, rate_max_deg_s: 20}
"""
OLD_FIRMWARE = """\
schema_version: 1
firmware: ardurover
frame: boat
groups: {one: {parameters: {FRAME_CLASS: {value: 2, reboot: true}}}}
"""


def test_a_vessel_of_version_1_names_its_recordings_apart() -> None:
    model = parse_vessel(OLD_VESSEL).model
    assert (model.source, model.log) == ("identified", ("a.csv", "b.tlog"))
    assert parse_vessel(OLD_VESSEL).schema_version == newest(VESSEL_STEPS)
    other = parse_vessel(OLD_VESSEL.replace("identified from a.csv, b.tlog", "Jiang et al. 2016")).model
    assert (other.source, other.log) == ("Jiang et al. 2016", ())


def test_a_mistake_in_an_old_file_keeps_its_place() -> None:
    with pytest.raises(InputError, match=r"boat\.yaml, line 3, column 16: model\.K_1_s is -1"):
        parse_vessel(OLD_VESSEL.replace("0.7", "-1"), "boat.yaml")


def test_a_firmware_file_of_version_1_is_read() -> None:
    firmware = firmware_from(parse_document(OLD_FIRMWARE))
    assert firmware.schema_version == newest(FIRMWARE_STEPS)
    assert wanted_parameters(firmware)[0].reboot


@pytest.mark.parametrize(
    ("version", "sentence"),
    [
        ("3", "f.yaml, line 1, column 17: schema_version is 3, this version of Norrbin reads 1 to 2; update Norrbin"),
        ("0", "schema_version is 0, this version of Norrbin reads 1 to 2; write 2."),
    ],
)
def test_unknown_versions_are_refused(version: str, sentence: str) -> None:
    text = OLD_FIRMWARE.replace("schema_version: 1", f"schema_version: {version}")
    with pytest.raises(InputError) as caught:
        migrated(parse_document(text, "f.yaml"), FIRMWARE_STEPS)
    assert sentence in str(caught.value)
