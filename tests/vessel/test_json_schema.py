"""The shipped JSON Schemas: current, true to what is read, and named in every shipped file."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

import jsonschema
import pytest
import yaml

from autopilot.cli.params import add_options
from autopilot.errors import InputError
from autopilot.files.strict_yaml import parse_document
from autopilot.firmware.file import KINDS, firmware_from, schema_text, shipped_firmware
from autopilot.firmware.foreign_files import load_any
from autopilot.vessel.file import dump_vessel, load_vessel, parse_vessel, shipped_vessels
from autopilot.vessel.schema import Vessel

DATA = resources.files("firmware_params")
SHIPPED = [("vessel", f"vessels/{name}.yaml") for name in shipped_vessels()]
SHIPPED += [("firmware", f"firmware/{name}.yaml") for name in shipped_firmware()]

VESSEL = """\
schema_version: 2
name: Boat
model: {K_1_s: 0.7, T_s: 0.3, reference_speed_m_s: 4.6}
rudder: {angle_max_deg: 30, rate_max_deg_s: 20}
sensors: {deviation_deg: [[0, 1.5], [90, -1]]}
"""
FIRMWARE = """\
schema_version: 2
firmware: ardurover
frame: boat
groups: {one: {parameters: {FRAME_CLASS: {value: 2, reboot: true}, SPEED_MAX: 1.5}}}
"""


def validator(kind: str) -> Any:
    schema = json.loads(schema_text(kind))
    jsonschema.Draft7Validator.check_schema(schema)
    return jsonschema.Draft7Validator(schema)


@pytest.mark.parametrize("kind", KINDS)
def test_the_shipped_schema_is_current(kind: str) -> None:
    shipped = (DATA / "schemas" / f"{kind}.schema.json").read_text(encoding="utf-8")
    command = f"autopilot params schema {kind} --out firmware_params/schemas/{kind}.schema.json"
    assert shipped == schema_text(kind), f"the typed schema has changed; run: {command}"


@pytest.mark.parametrize(("kind", "path"), SHIPPED)
def test_shipped_files_name_and_fulfil_it(kind: str, path: str) -> None:
    text = (DATA / path).read_text(encoding="utf-8")
    assert text.startswith(f"# yaml-language-server: $schema=../schemas/{kind}.schema.json\n")
    document = yaml.load(text, Loader=yaml.BaseLoader)
    assert document["schema_version"] == "2"
    validator(kind).validate(json.loads(json.dumps(yaml.safe_load(text), default=str)))


@pytest.mark.parametrize("name", shipped_vessels())
def test_every_number_shipped_has_its_source_and_date(name: str) -> None:
    """Sections whose numbers are all left at their defaults say nothing, and need not."""
    text = (DATA / "vessels" / f"{name}.yaml").read_text(encoding="utf-8")
    for section, held in yaml.safe_load(text).items():
        if isinstance(held, dict):
            assert held.get("source"), f"{name}: {section} has no source"
            assert held.get("date"), f"{name}: {section} has no date"


@pytest.mark.parametrize(
    ("kind", "old", "new"),
    [
        ("vessel", "name: Boat", "nmae: Boat"),
        ("vessel", "name: Boat\n", ""),
        ("vessel", "K_1_s: 0.7", "K_1_s: -0.7"),
        ("vessel", "K_1_s: 0.7", "K_1_s: fast"),
        ("vessel", "[0, 1.5]", "[0, 1.5, 2]"),
        ("vessel", "rate_max_deg_s: 20", "rate_max_deg_s: 0"),
        ("vessel", "schema_version: 2", "schema_version: 3"),
        ("vessel", "sensors:", "control: {law: fuzzy}\nsensors:"),
        ("firmware", "ardurover", "arducopter"),
        ("firmware", "value: 2", "value: two"),
        ("firmware", "reboot: true", "reboot: 1"),
        ("firmware", "reboot: true", "type: INT12"),
    ],
)
def test_what_the_schema_refuses_is_refused_in_reading_too(kind: str, old: str, new: str) -> None:
    text = (VESSEL if kind == "vessel" else FIRMWARE).replace(old, new, 1)
    check = validator(kind)
    assert not check.is_valid(yaml.safe_load(text))
    with pytest.raises(InputError):
        parse_vessel(text) if kind == "vessel" else firmware_from(parse_document(text))


def test_what_is_read_fulfils_the_schema() -> None:
    check = validator("vessel")
    check.validate(yaml.safe_load(VESSEL))
    check.validate(yaml.safe_load(dump_vessel(parse_vessel(VESSEL))))
    check.validate(yaml.safe_load(dump_vessel(load_vessel("lanxin"))))
    validator("firmware").validate(yaml.safe_load(FIRMWARE))
    assert isinstance(load_any("lanxin"), Vessel)


def test_the_command_writes_it(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    import argparse

    parser = argparse.ArgumentParser()
    add_options(parser.add_subparsers().add_parser("params"))
    for words in (["vessel"], ["vessel", "--out", str(tmp_path / "v.json")]):
        arguments = parser.parse_args(["params", "schema", *words])
        assert arguments.run(arguments) == 0
    assert capsys.readouterr().out.startswith(schema_text("vessel"))
    assert (tmp_path / "v.json").read_text() == schema_text("vessel")


@pytest.mark.parametrize("held", [VESSEL.encode(), b"\x00\x06a log"])
def test_a_schema_replaces_a_schema_alone(tmp_path: Any, held: bytes) -> None:
    import argparse

    parser = argparse.ArgumentParser()
    add_options(parser.add_subparsers().add_parser("params"))
    out = tmp_path / "my-boat.yaml"
    arguments = parser.parse_args(["params", "schema", "vessel", "--out", str(out)])
    out.write_bytes(held)
    with pytest.raises(InputError, match=r"my-boat\.yaml: exists already and is no JSON Schema"):
        arguments.run(arguments)
    assert out.read_bytes() == held
    out.write_text(schema_text("firmware"))
    assert arguments.run(arguments) == 0
    assert out.read_text() == schema_text("vessel")
