"""`autopilot params` on files and on what it reads from a vehicle: check, show, convert, diff, verify, backup."""

from __future__ import annotations

import argparse
import json
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest
from parameter_vehicle import ParameterVehicle
from pymavlink.dialects.v20 import ardupilotmega as dialect
from served_vehicle import ServedVehicle
from two_processes import free_port

from autopilot.cli import params as command
from autopilot.errors import InputError, RefusedError
from autopilot.firmware import session
from autopilot.firmware.file import load_firmware, wanted_parameters
from autopilot.firmware.foreign_files import read_foreign

VESSEL = """\
schema_version: 2
name: Boat
model: {K_1_s: -0.7, T_ms: 300, reference_speed_m_s: fast}
rudder: {angle_max_deg: 95, rate_max_deg_s: 20}
helm: {methd: rc_override}
"""


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NORRBIN_STATE", str(tmp_path / "state"))
    monkeypatch.setattr(session, "OTHERS_WAIT_S", 0.05)
    monkeypatch.setattr("autopilot.firmware.upload.SETTLE_S", 0.05)
    monkeypatch.setattr(session, "IDENTITY_WAIT_S", 0.05)


@pytest.fixture
def served() -> Iterator[ServedVehicle]:
    vehicle = ServedVehicle(free_port())
    vehicle.start()
    yield vehicle
    vehicle.stop.set()
    vehicle.join()


def link(served: ServedVehicle) -> str:
    return f"udpin:127.0.0.1:{served.address[1]}"


def call(*words: str) -> int:
    parser = argparse.ArgumentParser()
    command.add_options(parser.add_subparsers().add_parser("params"))
    arguments = parser.parse_args(["params", *words])
    return int(arguments.run(arguments))


def test_check_says_everything_that_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    Path("boat.yaml").write_text(VESSEL)
    assert call("check", "boat.yaml") == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 6
    assert all(line.startswith("autopilot: boat.yaml, line ") for line in lines)
    for part in (
        "K_1_s is -0.7",
        "the unit is in the key, use T_s",
        "T_s is missing",
        "the text 'fast'",
        "is 95",
        "methd",
    ):
        assert any(part in line for line in lines), part


def test_one_sentence_says_how_many_more_there_are() -> None:
    Path("boat.yaml").write_text(VESSEL)
    with pytest.raises(InputError, match=r"\(5 more mistakes; autopilot params check lists all\.\)"):
        call("show", "boat.yaml")


def test_convert_there_and_back_keeps_values_and_types(capsys: pytest.CaptureFixture[str]) -> None:
    Path("a.params").write_text("1\t1\tFRAME_CLASS\t2\t2\n1\t1\tCRUISE_SPEED\t4.6\t9\n1\t9\tCAM\t1\t6\n")
    assert call("convert", "a.params", "b.yaml", "--firmware", "ardurover") == 0
    assert "1 parameters of other components than 1 were left out" in capsys.readouterr().err
    assert call("convert", "b.yaml", "c.params", "--system", "7") == 0
    back = read_foreign("c.params")
    assert [(each.name, each.value, each.kind) for each in back.values] == [
        ("CRUISE_SPEED", 4.6, 9),
        ("FRAME_CLASS", 2, 2),
    ]
    assert (back.system, back.firmware) == (7, "ardurover")
    for name in ("d.param", "d.parm"):
        assert call("convert", "b.yaml", name) == 0
        assert {each.name: each.value for each in read_foreign(name).values} == {"CRUISE_SPEED": 4.6, "FRAME_CLASS": 2}
    assert call("convert", "d.param", "e.params") == 0
    assert "the type of 1 whole numbers is not known" in capsys.readouterr().err
    assert call("convert", "ardurover-boat", "f.param") == 0
    assert "SYSID_MYGCS" in capsys.readouterr().err


def test_convert_refuses_what_it_cannot_know() -> None:
    Path("a.params").write_text("1\t1\tA\t2\t6\n")
    with pytest.raises(InputError, match=r"a\.params does not say which firmware it is for; give --firmware"):
        call("convert", "a.params", "b.yaml")
    with pytest.raises(InputError, match="--firmware px4: ardurover-boat is for ardurover"):
        call("convert", "ardurover-boat", "b.yaml", "--firmware", "px4")
    with pytest.raises(InputError, match=r"b\.txt: the suffix says the format; allowed are \.yaml, \.yml, \.param"):
        call("convert", "ardurover-boat", "b.txt")
    with pytest.raises(InputError, match="lanxin is a vessel file"):
        call("convert", "lanxin", "b.param")
    Path("b.yaml").write_text("x")
    with pytest.raises(InputError, match=r"b\.yaml: exists already; give another name, or --overwrite"):
        call("convert", "ardurover-boat", "b.yaml")


def test_diff_of_files(capsys: pytest.CaptureFixture[str]) -> None:
    Path("a.parm").write_text("A 1\nB 2.5\nC 3\n")
    Path("b.param").write_text("A,1.0\nB,2.75\nD,4\n")
    assert call("diff", "a.parm", "b.param") == 6
    table = [line.split() for line in capsys.readouterr().out.splitlines()[1:4]]
    assert table == [["B", "2.5", "2.75"], ["C", "3", "-"], ["D", "-", "4"]]
    assert call("diff", "a.parm", "a.parm") == 0
    assert call("diff", "lanxin", "lanxin_paper_gains", "--json") == 6
    found = {
        each["name"]: (each["left"], each["right"]) for each in json.loads(capsys.readouterr().out.split("\n", 1)[1])
    }
    assert found["control.rate_hz"] == (20.0, 200.0)
    assert "model.K_1_s" not in found


def test_diff_and_verify_with_a_vehicle(served: ServedVehicle, capsys: pytest.CaptureFixture[str]) -> None:
    Path("a.parm").write_text("FRAME_CLASS 1\nRC_OVERRIDE_TIME 1.5\n")
    assert call("diff", "a.parm", link(served)) == 6
    assert "RC_OVERRIDE_TIME" in capsys.readouterr().out
    assert call("verify", "a.parm", "--link", link(served)) == 6
    assert "1 unchanged, 1 differs" in capsys.readouterr().out
    served.vehicle.table["RC_OVERRIDE_TIME"][0] = 1.5
    assert call("verify", "a.parm", "--link", link(served), "--json") == 0
    assert json.loads(capsys.readouterr().out)["counts"] == {"unchanged": 2}
    assert served.vehicle.sets_received == 0


def test_backup_and_download_formats(served: ServedVehicle, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("backup", "--link", link(served)) == 0
    path = next(Path().glob("backup-*-sys1.yaml"))
    assert {each.name: each.value for each in wanted_parameters(load_firmware(path))} == {
        "FRAME_CLASS": 1,
        "RC_OVERRIDE_TIME": 3.0,
        "X": 7,
    }
    assert call("download", "all.params", "--link", link(served)) == 0
    assert [tuple(each) for each in read_foreign("all.params").values] == [
        ("FRAME_CLASS", 1, 2),
        ("RC_OVERRIDE_TIME", 3.0, 9),
        ("X", 7, 6),
    ]
    with pytest.raises(InputError, match=r"all\.txt: the suffix says the format"):
        call("download", "all.txt", "--link", link(served))
    with pytest.raises(InputError, match="the vehicle has no parameter NOPE; nothing was written"):
        call("download", "some.parm", "--names", "X,NOPE", "--link", link(served))
    with pytest.raises(InputError, match="nowhere"):
        call("backup", "--link", link(served), "--folder", "nowhere")


def test_upload_to_px4_by_its_own_encoding(capsys: pytest.CaptureFixture[str]) -> None:
    """Whole numbers beyond 2^24 keep every bit, and the checksum of the table is compared."""
    vehicle = ServedVehicle(free_port(), dialect.MAV_AUTOPILOT_PX4)
    wanted = wanted_parameters(load_firmware("px4-rover-boat"))
    table = {each.name: (0.0, 9) if isinstance(each.value, float) else (0, 6) for each in wanted}
    vehicle.vehicle = ParameterVehicle({"P0000": (0, 6), **table, "BIG": (0, 6)}, bytewise=True)
    vehicle.vehicle.hash = True
    vehicle.start()
    try:
        assert call("upload", "px4-rover-boat", "--link", link(vehicle)) == 0
        Path("big.params").write_text("# Stack: PX4 Pro\n1\t1\tBIG\t16777217\t6\n")
        assert call("upload", "big.params", "--link", link(vehicle)) == 0
        assert call("download", "all.params", "--link", link(vehicle)) == 0
        with pytest.raises(RefusedError, match="is for ardurover, but vehicle 1 is px4; nothing was sent"):
            call("upload", "ardurover-boat", "--link", link(vehicle))
    finally:
        vehicle.stop.set()
        vehicle.join()
    held = {each.name: each.value for each in read_foreign("all.params").values}
    assert held["BIG"] == 16_777_217
    for each in wanted:
        assert struct.pack("<f", held[each.name]) == struct.pack("<f", each.value)
    captured = capsys.readouterr()
    assert "takes effect after a reboot of the vehicle: MAV_1_CONFIG" in captured.out
    assert "PX4's checksum of the whole table agrees" in captured.err
