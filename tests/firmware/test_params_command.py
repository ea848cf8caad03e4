"""`autopilot params` as its users call it: real files, a real UDP socket, a vehicle in a thread."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from served_vehicle import ServedVehicle
from two_processes import free_port

from autopilot.cli import params as command
from autopilot.errors import InputError, RefusedError
from autopilot.firmware import session
from autopilot.firmware.file import load_firmware, wanted_parameters
from autopilot.links.base import LinkError
from autopilot.vessel.file import load_vessel

FILE = """\
schema_version: 2
firmware: ardurover
frame: boat
groups:
  one:
    parameters:
      FRAME_CLASS: {value: 2, reboot: true}
      RC_OVERRIDE_TIME: 1.5
"""


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def served(port: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServedVehicle]:
    monkeypatch.setattr(session, "OTHERS_WAIT_S", 0.05)
    monkeypatch.setattr("autopilot.firmware.upload.SETTLE_S", 0.05)
    monkeypatch.setattr(session, "IDENTITY_WAIT_S", 0.05)
    monkeypatch.setenv("NORRBIN_STATE", str(tmp_path / "state"))
    vehicle = ServedVehicle(port)
    vehicle.start()
    yield vehicle
    vehicle.stop.set()
    vehicle.join()


def call(*words: str) -> int:
    parser = argparse.ArgumentParser()
    command.add_options(parser.add_subparsers().add_parser("params"))
    arguments = parser.parse_args(["params", *words])
    return int(arguments.run(arguments))


def test_upload_sets_reads_back_and_backs_up(
    served: ServedVehicle,
    port: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("boat.yaml").write_text(FILE)
    link = ("--link", f"udpin:127.0.0.1:{port}")
    assert call("upload", "boat.yaml", *link, "--dry-run") == 6
    assert "2 would set" in capsys.readouterr().out
    assert served.vehicle.sets_received == 0
    assert call("upload", "boat.yaml", *link, "--backup", "old.yaml") == 0
    output = capsys.readouterr().out
    assert "2 set" in output
    assert "takes effect after a reboot of the vehicle: FRAME_CLASS" in output
    assert served.vehicle.table["RC_OVERRIDE_TIME"][0] == 1.5
    assert call("upload", "old.yaml", *link, "--no-backup", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["counts"] == {"set": 2}
    assert report["parameters"][0] == {
        "name": "FRAME_CLASS",
        "old": 2,
        "wanted": 1,
        "now": 1,
        "verdict": "set",
        "reason": "",
        "reboot": False,
    }
    assert served.vehicle.table["RC_OVERRIDE_TIME"][0] == 3.0


def test_a_constrained_value_gives_exit_code_6(
    served: ServedVehicle, port: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    served.vehicle.limits["RC_OVERRIDE_TIME"] = (2.0, 9.0)
    file = tmp_path / "boat.yaml"
    file.write_text(FILE)
    assert call("upload", str(file), "--link", f"udpin:127.0.0.1:{port}", "--no-backup") == 6
    assert "constrained: the vehicle holds another value than was sent" in " ".join(capsys.readouterr().out.split())


def test_download_writes_a_file_that_can_be_uploaded(served: ServedVehicle, port: int, tmp_path: Path) -> None:
    file = tmp_path / "all.yaml"
    link = ("--link", f"udpin:127.0.0.1:{port}", "--system", "1")
    assert call("download", str(file), *link) == 0
    values = {each.name: each.value for each in wanted_parameters(load_firmware(file))}
    assert values == {"FRAME_CLASS": 1, "RC_OVERRIDE_TIME": 3.0, "X": 7}
    with pytest.raises(InputError, match="exists already"):
        call("download", str(file), *link)
    assert call("download", str(file), *link, "--overwrite", "--names", "X") == 0
    assert [each.name for each in wanted_parameters(load_firmware(file))] == ["X"]


def test_a_file_for_another_firmware_is_refused(served: ServedVehicle, port: int, tmp_path: Path) -> None:
    file = tmp_path / "px4.yaml"
    file.write_text(FILE.replace("ardurover", "px4"))
    with pytest.raises(RefusedError, match="is for px4, but vehicle 1 is ardurover; nothing was sent"):
        call("upload", str(file), "--link", f"udpin:127.0.0.1:{port}")
    assert served.vehicle.sets_received == 0


def test_a_backup_that_cannot_be_written_stops_the_upload(served: ServedVehicle, port: int, tmp_path: Path) -> None:
    file = tmp_path / "boat.yaml"
    file.write_text(FILE)
    with pytest.raises(InputError, match="cannot be written"):
        call("upload", str(file), "--link", f"udpin:127.0.0.1:{port}", "--backup", str(tmp_path / "no" / "old.yaml"))
    assert served.vehicle.sets_received == 0


def test_no_heartbeat_is_one_sentence(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "HEARTBEAT_WAIT_S", 0.1)
    with pytest.raises(LinkError, match=r"no heartbeat of a vehicle within 0\.1 s; check that it is powered"):
        call("upload", "ardurover-boat", "--link", f"udpin:127.0.0.1:{port}")


def test_a_vehicle_that_falls_silent_is_reported_with_what_was_done(
    served: ServedVehicle,
    port: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(session, "SILENCE_MAX_S", 0.3)
    file = tmp_path / "boat.yaml"
    file.write_text(FILE)
    served.vehicle.set = lambda message: served.stop.set()  # type: ignore[method-assign]
    with pytest.raises(LinkError, match=r"vehicle 1 has been silent for 0\.3 s"):
        call("upload", str(file), "--link", f"udpin:127.0.0.1:{port}", "--no-backup")
    output = capsys.readouterr().out
    assert "NOT FINISHED: the vehicle may hold old and new values" in output
    assert "unconfirmed: sent, but not read back" in output


def test_an_nmea_link_and_a_vessel_file_are_refused() -> None:
    with pytest.raises(InputError, match="parameters travel over MAVLink"):
        call("upload", "ardurover-boat", "--link", "nmea:/dev/ttyUSB0:4800")
    with pytest.raises(InputError, match="lanxin is a vessel file, which Norrbin reads itself"):
        call("convert", "lanxin", "lanxin.param")


def test_check_reports_every_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("check", "lanxin", "lanxin_paper_gains", "ardurover-boat") == 0
    bad = tmp_path / "bad.yaml"
    bad.write_text("schema_version: 2\nname: X\nmodle: {}\n")
    assert call("check", str(bad), str(tmp_path / "none.yaml"), "lanxin") == 2
    captured = capsys.readouterr()
    assert "line 3, column 1: modle is not a known key; did you mean model?" in captured.err
    assert "none.yaml: no such file" in captured.err
    assert "lanxin: vessel file, nothing wrong" in captured.out


def test_show_fills_in_defaults(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("show", "lanxin", "--json") == 0
    assert json.loads(capsys.readouterr().out)["model"]["K_1_s"] == load_vessel("lanxin").model.K_1_s
    assert call("show", "lanxin") == 0
    assert "K_1_s: 0.701  # rudder gain K" in capsys.readouterr().out
    assert call("show", "ardurover-boat") == 0
    assert "SERVO1_FUNCTION   26          ground steering" in capsys.readouterr().out
