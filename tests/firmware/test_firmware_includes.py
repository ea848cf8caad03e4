"""Firmware files built on one another: what is included, overridden and left out, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from autopilot.errors import InputError
from autopilot.firmware.file import entries, load_firmware, wanted_parameters

BASE = """\
schema_version: 2
firmware: ardurover
frame: boat
groups:
  steering:
    doc: the rudder
    parameters:
      RC1_DZ: {value: 30, doc: dead zone, unit: us, min: 0, max: 200, reboot: true}
      SYSID_MYGCS: {value: 255, also_named: [MAV_GCS_SYSID]}
  speed:
    parameters: {CRUISE_SPEED: 2.0}
"""
BOAT = """\
schema_version: 2
firmware: ardurover
frame: boat
include: [base.yaml]
leave_out: [CRUISE_SPEED]
groups:
  mine:
    doc: my own
    parameters:
      RC1_DZ: 20
      SERVO1_TRIM: 1512
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "base.yaml").write_text(BASE)
    return tmp_path


def load(folder: Path, text: str) -> dict[str, float]:
    (folder / "boat.yaml").write_text(text)
    return {each.name: each.value for each in wanted_parameters(load_firmware(folder / "boat.yaml"))}


def test_a_boat_overrides_what_it_includes_and_keeps_its_explanation(folder: Path) -> None:
    assert load(folder, BOAT) == {"RC1_DZ": 20, "SYSID_MYGCS": 255, "SERVO1_TRIM": 1512}
    firmware = load_firmware(folder / "boat.yaml")
    found = {name: (group, entry) for group, name, entry in entries(firmware)}
    group, entry = found["RC1_DZ"]
    assert (group, entry.doc, entry.reboot, entry.max) == ("steering", "dead zone", True, 200)
    assert found["SERVO1_TRIM"][0] == "mine"
    assert firmware.groups["mine"].doc == "my own"


def test_a_shipped_file_can_be_included_by_name(folder: Path) -> None:
    values = load(folder, BOAT.replace("base.yaml", "ardurover-boat").replace("[CRUISE_SPEED]", "[RC_OVERRIDE_TIME]"))
    assert values["SERVO1_FUNCTION"] == 26
    assert values["RC1_DZ"] == 20
    assert "RC_OVERRIDE_TIME" not in values


def test_an_override_is_held_to_the_range_it_inherits(folder: Path) -> None:
    with pytest.raises(InputError, match=r"boat\.yaml, line 10, column 15: RC1_DZ is 999, allowed are 0 to 200 us\."):
        load(folder, BOAT.replace("RC1_DZ: 20", "RC1_DZ: 999"))


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("base.yaml", "bose.yaml", "boat.yaml, line 4, column 10: include: "),
        ("base.yaml", "bose.yaml", "bose.yaml: no such file; did you mean base.yaml?"),
        ("base.yaml", "boat.yaml", "the files include each other without end"),
        ("CRUISE_SPEED]", "CRUISE_SPED]", "leave_out: CRUISE_SPED is not in what this file includes; did you mean"),
        ("SERVO1_TRIM", "MAV_GCS_SYSID", "MAV_GCS_SYSID is another name of SYSID_MYGCS, which is included"),
        ("firmware: ardurover", "firmware: px4", "include: base.yaml is for ardurover, this file is for px4."),
        ("[base.yaml]", "[base.yaml, other.yaml]", "include: SYSID_MYGCS is in base.yaml and in other.yaml; give the"),
    ],
)
def test_each_mistake_is_one_sentence(folder: Path, old: str, new: str, sentence: str) -> None:
    (folder / "other.yaml").write_text(BASE.replace("CRUISE_SPEED", "SPEED_MAX"))
    with pytest.raises(InputError) as caught:
        load(folder, BOAT.replace(old, new, 1))
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_files_that_include_each_other_are_refused(folder: Path) -> None:
    (folder / "base.yaml").write_text(BASE.replace("groups:", "include: [boat.yaml]\ngroups:"))
    with pytest.raises(InputError, match="the files include each other without end"):
        load(folder, BOAT)
