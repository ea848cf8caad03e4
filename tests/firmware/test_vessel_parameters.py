"""A vessel's numbers as MAVLink parameters: every one has its own short name, its range, and the way there and back."""

from __future__ import annotations

import argparse
import dataclasses
import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from parameter_vehicle import ParameterVehicle
from pymavlink.dialects.v20 import ardupilotmega as dialect
from served_vehicle import ServedVehicle
from two_processes import free_port

from autopilot.cli import params as command
from autopilot.firmware import session
from autopilot.firmware.foreign_files import load_parameters
from autopilot.vessel.file import dump_vessel, load_vessel, parse_vessel
from autopilot.vessel.parameters import VesselParameter, parameters_of, value_of, with_value
from autopilot.vessel.schema import Limits, Vessel

LANXIN = load_vessel("lanxin")
FULL = dataclasses.replace(LANXIN, limits=Limits(angle_max_deg=25.0, rate_max_deg_s=10.0))
TABLE = {each.name: each for each in parameters_of(FULL)}


def test_names_are_short_unique_and_every_number_of_the_file_is_among_them() -> None:
    names = [each.name for each in parameters_of(FULL)]
    assert len(set(names)) == len(names)
    assert all(len(name) <= 16 and name == name.upper() for name in names)
    paths = {each.path for each in parameters_of(FULL)}
    assert {"control.backstepping.k1_1_s", "control.pid.kd_s", "limits.angle_max_deg", "failsafe.action"} <= paths
    assert {"BS_K1", "BS_GAMMA", "MDL_K", "FS_HDG_TIMEOUT", "LIM_ANGLE_MAX", "CTL_LAW"} <= set(names)
    assert "LIM_ANGLE_MAX" not in {each.name for each in parameters_of(LANXIN)}


def test_each_has_its_unit_range_and_meaning() -> None:
    gain = TABLE["BS_K1"]
    assert (gain.unit, gain.high, gain.doc) == ("1/s", 1000.0, "heading gain k1")
    assert TABLE["RUD_RATE_MAX"].unit == "deg/s"
    actions = "0 (release), 1 (amidships), 2 (hold), 3 (dead_reckoning), 4 (windward), 5 (firmware)"
    assert TABLE["FS_ACTION"].allowed == actions
    assert TABLE["CTL_RATE"].allowed == "1 to 200 hz"


@pytest.mark.parametrize("parameter", parameters_of(FULL), ids=lambda each: each.name)
def test_setting_a_parameter_to_what_it_is_changes_nothing(parameter: VesselParameter) -> None:
    assert with_value(FULL, parameter, value_of(FULL, parameter)) == FULL


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(["BS_K1", "PID_KP", "MDL_K", "LIM_ANGLE_MAX"]), st.floats(0.015625, 20.0, width=32))
def test_what_is_set_is_what_is_read_in_memory_and_in_the_file(name: str, value: float) -> None:
    try:
        changed = with_value(FULL, TABLE[name], value)
    except ValueError as error:
        assert str(error).startswith(("LIM_ANGLE_MAX is", "BS_K1", "PID_KP", "MDL_K"))
        return
    assert value_of(changed, TABLE[name]) == value
    again = parse_vessel(dump_vessel(changed))
    assert struct.pack("<f", value_of(again, TABLE[name])) == struct.pack("<f", value)


def test_a_file_gets_the_short_number() -> None:
    single = struct.unpack("<f", struct.pack("<f", 0.7))[0]
    assert single != 0.7
    assert with_value(FULL, TABLE["GUI_RUDDER_SHARE"], single).guidance.rudder_share == 0.7


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("BS_K1", -1.0, "BS_K1 is -1, allowed: 1e-09 to 1000 1/s."),
        ("BS_K1", float("nan"), "BS_K1 is nan, allowed: 1e-09 to 1000 1/s."),
        (
            "CTL_LAW",
            4.0,
            "CTL_LAW is 4, allowed: 0 (backstepping), 1 (pid), 2 (sliding), 3 (sliding_roll).",
        ),
        (
            "CTL_LAW",
            0.5,
            "CTL_LAW is 0.5, allowed: 0 (backstepping), 1 (pid), 2 (sliding), 3 (sliding_roll).",
        ),
        ("FS_RESUME", 2.0, "FS_RESUME is 2, allowed: 0 (false), 1 (true)."),
        ("LIM_ANGLE_MAX", 31.0, "limits.angle_max_deg is 31, allowed is at most rudder.angle_max_deg (30)."),
        ("MDL_N1", 0.5, "model.n1 is 0.5, allowed are 1 (course-stable) and -1 (course-unstable)."),
    ],
)
def test_what_is_not_allowed_is_one_sentence(name: str, value: float, sentence: str) -> None:
    with pytest.raises(ValueError) as caught:
        with_value(FULL, TABLE[name], value)
    assert str(caught.value) == sentence


def test_an_upload_knows_what_waits_for_the_next_start() -> None:
    wanted = {each.name: each.reboot for each in load_parameters("lanxin", vessel_too=True).wanted}
    assert wanted["CTL_LAW"] and wanted["SNS_MAGNETIC"] and not wanted["BS_K1"]


def test_a_vessel_file_is_uploaded_to_a_running_norrbin_and_taken_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(session, "OTHERS_WAIT_S", 0.05)
    monkeypatch.setattr("autopilot.firmware.upload.SETTLE_S", 0.05)
    monkeypatch.setattr(session, "IDENTITY_WAIT_S", 0.05)
    monkeypatch.setenv("NORRBIN_STATE", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    running = ServedVehicle(free_port(), dialect.MAV_AUTOPILOT_GENERIC)
    running.vehicle = ParameterVehicle({each.name: (value_of(LANXIN, each), 9) for each in parameters_of(LANXIN)})
    assert LANXIN.control.backstepping is not None
    gains = dataclasses.replace(LANXIN.control.backstepping, k1_1_s=0.7)
    mine: Vessel = dataclasses.replace(LANXIN, control=dataclasses.replace(LANXIN.control, backstepping=gains))
    Path("mine.yaml").write_text(dump_vessel(mine))
    parser = argparse.ArgumentParser()
    command.add_options(parser.add_subparsers().add_parser("params"))
    link = ["--link", f"udpin:127.0.0.1:{running.address[1]}"]
    running.start()
    try:
        for words, code in (
            (["verify", "lanxin"], 0),
            (["verify", "mine.yaml"], 6),
            (["upload", "mine.yaml", "--backup", "old.yaml"], 0),
            (["verify", "mine.yaml"], 0),
            (["restore", "old.yaml"], 0),
            (["verify", "lanxin"], 0),
        ):
            arguments = parser.parse_args(["params", *words, *link])
            assert arguments.run(arguments) == code, (words, capsys.readouterr())
    finally:
        running.stop.set()
        running.join()
