"""A whole vehicle backed up and written back: quick, exit 0, and nothing that is no setting is ever written."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from parameter_vehicle import BadLink, ParameterVehicle, converse
from served_vehicle import ServedVehicle
from two_processes import free_port, simulator

from autopilot.cli import params as command
from autopilot.errors import InputError, RefusedError
from autopilot.firmware import session
from autopilot.firmware.file import Wanted, load_firmware, shipped_firmware, wanted_parameters
from autopilot.firmware.journal import Journal, read_journal, write_journal
from autopilot.firmware.metadata import RULES, Kept, kept_by_firmware, settings_of
from autopilot.firmware.protocol import Target
from autopilot.firmware.upload import Change, Upload, Verdict
from sitl.firmware_parameters import default_parameters

REAL_COUNT = 1283
"""So many has ArduRover 4.6.2."""
INT8, INT16, INT32, REAL32 = 2, 4, 6, 9
JOURNAL = Path("state") / "upload-1-1.json"


class MovingVehicle(ParameterVehicle):
    """A table of real size in which some values are others each time they are looked at, or cannot be set."""

    def __init__(self) -> None:
        rows = {each.name: (each.value, int(each.kind)) for each in default_parameters()}
        filler = {f"X{number}_GAIN": (0.5, REAL32) for number in range(REAL_COUNT - len(rows))}
        super().__init__(rows | filler)
        self.read_only = {each.name for each in default_parameters() if each.is_read_only}
        self.moving = {"BARO1_GND_PRESS", "BARO2_GND_PRESS", "STAT_RUNTIME"}
        self.set_names: list[str] = []
        self.messages = 0

    def packet(self, name: str, index: int) -> bytes:
        if name in self.moving:
            self.table[name][0] += 1.0
        return super().packet(name, index)

    def handle(self, message: Any) -> None:
        self.messages += message.get_type().startswith("PARAM")
        super().handle(message)

    def set(self, message: Any) -> None:
        self.set_names.append(message.param_id)
        super().set(message)


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
    vehicle.vehicle = MovingVehicle()
    vehicle.start()
    yield vehicle
    vehicle.stop.set()
    vehicle.join()


def moving(served: ServedVehicle) -> MovingVehicle:
    assert isinstance(served.vehicle, MovingVehicle)
    return served.vehicle


def call(link: str, *words: str) -> int:
    parser = argparse.ArgumentParser()
    command.add_options(parser.add_subparsers().add_parser("params"))
    arguments = parser.parse_args(["params", *words, "--link", link])
    return int(arguments.run(arguments))


def on(served: ServedVehicle) -> str:
    return f"udpin:127.0.0.1:{served.address[1]}"


def write(name: str, **wanted: float) -> str:
    Path(name).write_text("".join(f"{key} {value}\n" for key, value in wanted.items()))
    return name


def backed_up(link: str) -> str:
    assert call(link, "backup") == 0
    return str(next(Path().glob("backup-*.yaml")))


def test_a_backup_restored_to_the_same_vehicle_writes_nothing(
    served: ServedVehicle, capsys: pytest.CaptureFixture[str]
) -> None:
    path = backed_up(on(served))
    assert "a restore leaves 50 to the firmware: erases" in capsys.readouterr().out
    assert len(wanted_parameters(load_firmware(path))) == REAL_COUNT
    moving(served).messages = 0
    assert call(on(served), "restore", path) == 0
    output = capsys.readouterr().out
    assert f"{REAL_COUNT - 50} unchanged" in output
    line = next(line for line in output.splitlines() if "left to the firmware" in line)
    assert "FORMAT_VERSION" in line and "moves by itself (BARO1_GND_PRESS" in line and "--with-calibration" in line
    assert not moving(served).set_names
    # one question for the list, and for what it lost
    assert moving(served).messages < 40
    assert not JOURNAL.exists()


def test_a_truncated_backup_is_refused_and_one_without_count_warned_of(
    served: ServedVehicle, capsys: pytest.CaptureFixture[str]
) -> None:
    path = Path(backed_up(on(served)))
    lines = path.read_text().splitlines(keepends=True)
    half = next(number for number in range(len(lines) // 2, len(lines)) if lines[number].startswith(6 * " "))
    Path("cut.yaml").write_text("".join(lines[: half + 1]))
    for action in ("restore", "upload"):
        with pytest.raises(InputError, match=f"written with {REAL_COUNT} parameters and holds .*cut off"):
            call(on(served), action, "cut.yaml")
    assert not moving(served).set_names
    assert call(on(served), "restore", str(path)) == 0
    assert "how many parameters" not in capsys.readouterr().err
    Path("old.yaml").write_text("".join(line for line in lines if not line.startswith(("count:", "checksum:"))))
    assert call(on(served), "restore", "old.yaml") == 0
    assert "old.yaml does not say how many parameters it was written with" in capsys.readouterr().err


def test_a_restore_writes_what_differs_and_no_more(served: ServedVehicle, capsys: pytest.CaptureFixture[str]) -> None:
    path = backed_up(on(served))
    table = served.vehicle.table
    table["X7_GAIN"][0], table["CRUISE_SPEED"][0] = 0.75, 2.0
    table["FORMAT_VERSION"][0], table["STAT_BOOTCNT"][0], table["COMPASS_OFS_X"][0] = 15, 9, 77.0
    capsys.readouterr()
    assert call(on(served), "restore", path, "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert sorted(moving(served).set_names) == ["CRUISE_SPEED", "X7_GAIN"]
    assert report["counts"] == {"set": 2, "unchanged": REAL_COUNT - 52}
    left = {each["name"]: each["why"] for each in report["left_out"]}
    assert left["FORMAT_VERSION"] == "erases the vehicle's parameters"
    assert left["COMPASS_OFS_X"] == "calibration"
    assert (table["FORMAT_VERSION"][0], table["COMPASS_OFS_X"][0]) == (15, 77.0)
    assert call(on(served), "restore", path, "--with-calibration") == 0
    assert table["COMPASS_OFS_X"][0] == 5.0
    assert {"FORMAT_VERSION", "STAT_BOOTCNT", "COMPASS_DEV_ID"}.isdisjoint(moving(served).set_names)


def test_an_upload_leaves_to_the_firmware_what_is_its_own(
    served: ServedVehicle, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write("mine.parm", FORMAT_VERSION=0, STAT_BOOTCNT=5, BARO1_GND_PRESS=1.0, CRUISE_SPEED=3.0, INS_ACC_ID=9)
    assert call(on(served), "upload", file) == 0
    assert moving(served).set_names == ["CRUISE_SPEED"]
    assert "4 left to the firmware: erases the vehicle's parameters (FORMAT_VERSION)" in capsys.readouterr().out
    assert call(on(served), "verify", file) == 0


def test_only_what_is_no_setting_is_nothing_to_do(served: ServedVehicle, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(on(served), "upload", write("mine.parm", FORMAT_VERSION=0)) == 0
    assert "vehicle 1 (ardurover): nothing" in capsys.readouterr().out
    assert not moving(served).set_names


def cut_off(*changes: Change, backup: str = "") -> None:
    write_journal(JOURNAL, Journal("cut.parm", "yesterday", 1, "ardurover", "", backup, changes))


def test_a_journal_with_what_moves_by_itself_is_settled(served: ServedVehicle) -> None:
    """An earlier version put ground pressures and boot counts into journals."""
    moved = Change("BARO1_GND_PRESS", REAL32, 99.0, 98.0), Change("STAT_BOOTCNT", INT16, 7, 8)
    for to in ([], ["--to", "old"], ["--to", "new"], ["--to", "as-is"]):
        cut_off(*moved, Change("CRUISE_SPEED", REAL32, 2.5, 3.5))
        assert call(on(served), "restore", *to) == 0, to
        assert not JOURNAL.exists()
    assert set(moving(served).set_names) == {"CRUISE_SPEED"}
    cut_off(*moved)
    assert call(on(served), "restore") == 0
    assert not JOURNAL.exists()


def test_what_the_vehicle_never_takes_is_settled_by_its_owner(
    served: ServedVehicle, capsys: pytest.CaptureFixture[str]
) -> None:
    served.vehicle.read_only |= {"CRUISE_SPEED"}
    for to in ("old", "new"):
        cut_off(Change("CRUISE_SPEED", REAL32, 2.5, 3.5), Change("X1_GAIN", REAL32, 0.25, 0.75))
        assert call(on(served), "restore") == 6
        assert "--to old, or --to new, as far as the vehicle takes them, or --to as-is" in capsys.readouterr().err
        assert JOURNAL.exists()
        assert call(on(served), "restore", "--to", to) == 6
        assert f"holds the {to} values but for CRUISE_SPEED, which it does not take" in capsys.readouterr().err
        assert served.vehicle.table["X1_GAIN"][0] == (0.25 if to == "old" else 0.75)
        assert not JOURNAL.exists()
    assert call(on(served), "upload", write("next.parm", X1_GAIN=0.5)) == 0


def test_a_vehicle_left_as_it_is_says_what_that_is(served: ServedVehicle, capsys: pytest.CaptureFixture[str]) -> None:
    cut_off(Change("X1_GAIN", REAL32, 0.25, 0.75), Change("GONE", REAL32, 1.0, 2.0), backup="old.yaml")
    assert call(on(served), "restore", "--to", "as-is") == 0
    output = capsys.readouterr().out
    assert [line.split() for line in output.splitlines()[1:3]] == [
        ["X1_GAIN", "0.25", "0.75", "0.5"],
        ["GONE", "1", "2", "-"],
    ]
    assert "is left as it is; the old values are in old.yaml" in output
    assert not moving(served).set_names and not JOURNAL.exists()


def test_a_backup_that_holds_all_of_it_settles_an_upload_that_was_cut_off(
    served: ServedVehicle, capsys: pytest.CaptureFixture[str]
) -> None:
    path = backed_up(on(served))
    served.vehicle.table["X1_GAIN"][0] = 0.75
    cut_off(Change("X1_GAIN", REAL32, 0.5, 0.75))
    with pytest.raises(RefusedError, match="was cut off"):
        call(on(served), "upload", path)
    with pytest.raises(RefusedError, match=r"part\.parm does not hold X1_GAIN, which it has changed"):
        call(on(served), "restore", write("part.parm", X2_GAIN=0.5))
    assert call(on(served), "restore", path) == 0
    assert served.vehicle.table["X1_GAIN"][0] == 0.5
    assert not JOURNAL.exists()
    cut_off(Change("X1_GAIN", REAL32, 0.5, 0.75))
    assert call(on(served), "restore", path) == 0
    assert "the upload of cut.parm (yesterday) is settled" in capsys.readouterr().err
    assert not JOURNAL.exists()


def test_a_restore_that_loses_power_leads_back_to_before_the_first_upload(
    served: ServedVehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = backed_up(on(served))
    served.vehicle.table["X1_GAIN"][0], served.vehicle.table["X2_GAIN"][0] = 0.75, 0.25
    cut_off(Change("X1_GAIN", REAL32, 0.125, 0.75), Change("X3_GAIN", REAL32, 0.0625, 0.5))
    with monkeypatch.context() as patch:
        patch.setattr(Upload, "proceed", lambda self: (_ for _ in ()).throw(SystemExit(9)))
        with pytest.raises(SystemExit):
            call(on(served), "restore", path)
    journal = read_journal(JOURNAL)
    assert journal is not None
    assert sorted(journal.changes) == [
        ("X1_GAIN", REAL32, 0.125, 0.5),
        ("X2_GAIN", REAL32, 0.25, 0.5),
        ("X3_GAIN", REAL32, 0.0625, 0.5),
    ]
    assert call(on(served), "restore", "--to", "old") == 0
    assert [served.vehicle.table[f"X{n}_GAIN"][0] for n in (1, 2, 3)] == [0.125, 0.25, 0.0625]


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_long_file_is_read_by_the_list_and_what_it_lost_by_name(loss: float) -> None:
    vehicle = ParameterVehicle({f"P{number:04}": (float(number), REAL32) for number in range(200)})
    wanted = [Wanted((f"P{number:04}",), float(number)) for number in range(200)]
    wanted[7] = Wanted(("P0007",), 7.5)
    client = Upload(Target(1, 1), wanted)
    lines = BadLink(1, loss, 0.1, (0.005, 0.05)), BadLink(2, loss, 0.1, (0.005, 0.05))
    while not client.is_over:
        converse(client, vehicle, *lines, limit_s=120.0)
        client.proceed()
    assert {each.verdict for each in client.outcomes()} == {Verdict.UNCHANGED, Verdict.SET}
    assert vehicle.table["P0007"][0] == 7.5
    assert vehicle.sets_received < 10


@pytest.mark.parametrize(
    ("firmware", "name", "kept"),
    [
        ("ardurover", "FORMAT_VERSION", Kept.FORMAT),
        ("ardurover", "SYSID_SW_MREV", Kept.FORMAT),
        ("ardurover", "STAT_FLTTIME", Kept.STATE),
        ("ardurover", "BARO3_GND_PRESS", Kept.STATE),
        ("ardurover", "MIS_TOTAL", Kept.STATE),
        ("ardurover", "BARO1_DEVID", Kept.DEVICE),
        ("ardurover", "COMPASS_DEV_ID3", Kept.DEVICE),
        ("ardurover", "COMPASS_PRIO1_ID", Kept.DEVICE),
        ("ardurover", "INS4_ACC_ID", Kept.DEVICE),
        ("ardurover", "INS_GYR2_ID", Kept.DEVICE),
        ("ardurover", "INS_GYROFFS_Z", Kept.CALIBRATION),
        ("ardurover", "INS_GYR3OFFS_X", Kept.CALIBRATION),
        ("ardurover", "INS_ACCSCAL_Y", Kept.CALIBRATION),
        ("ardurover", "INS5_ACCOFFS_X", Kept.CALIBRATION),
        ("ardurover", "INS_TCAL2_ACC3_Z", Kept.CALIBRATION),
        ("ardurover", "INS4_TCAL_GYR1_X", Kept.CALIBRATION),
        ("ardurover", "COMPASS_OFS2_Y", Kept.CALIBRATION),
        ("ardurover", "COMPASS_MOT_X", Kept.CALIBRATION),
        ("ardurover", "AHRS_TRIM_Y", Kept.CALIBRATION),
        ("ardurover", "SYSID_THISMAV", None),
        ("ardurover", "COMPASS_DEC", None),
        ("ardurover", "COMPASS_MOTCT", None),
        ("ardurover", "INS_GYR_CAL", None),
        ("ardurover", "INS_TCAL1_ENABLE", None),
        ("ardurover", "RC1_TRIM", None),
        ("ardurover", "BATT_MONITOR", None),
        ("px4", "CAL_GYRO0_XOFF", Kept.CALIBRATION),
        ("px4", "CAL_MAG1_ID", Kept.DEVICE),
        ("px4", "LND_FLIGHT_T_LO", Kept.STATE),
        ("px4", "SYS_AUTOCONFIG", Kept.FORMAT),
        ("px4", "FORMAT_VERSION", None),
        ("norrbin", "STAT_X", None),
    ],
)
def test_what_is_no_setting(firmware: str, name: str, kept: Kept | None) -> None:
    assert kept_by_firmware(firmware, name) is kept


def test_shipped_files_hold_settings_alone() -> None:
    assert set(RULES) == {"ardurover", "px4"}
    for name in shipped_firmware():
        file = load_firmware(name)
        assert settings_of(wanted_parameters(file), file.firmware)[1] == []


@pytest.mark.real_time
def test_the_simulated_firmware_is_backed_up_and_restored(capsys: pytest.CaptureFixture[str]) -> None:
    port = free_port()
    link = f"udpin:127.0.0.1:{port}"
    with simulator(1.0, "--disarmed", "--mavlink", f"udpout:127.0.0.1:{port}"):
        path = backed_up(link)
        Path("mine.parm").write_text("CRUISE_SPEED 2.5\n")
        assert call(link, "upload", "mine.parm", "--no-backup") == 0
        assert call(link, "restore", path) == 0
        assert "1 set" in capsys.readouterr().out
        assert call(link, "restore", path) == 0
        assert " unchanged\n" in capsys.readouterr().out
        assert not JOURNAL.exists()
