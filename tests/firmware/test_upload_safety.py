"""An upload is wholly done or wholly undone: order, rollback, interrupts, journals, armed vehicles."""

from __future__ import annotations

import argparse
import errno
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from parameter_vehicle import BadLink, ParameterVehicle, converse
from pymavlink.dialects.v20 import ardupilotmega as dialect
from served_vehicle import ServedVehicle
from two_processes import free_port

from autopilot.cli import params as command
from autopilot.cli import params_upload
from autopilot.errors import InputError, RefusedError
from autopilot.firmware import journal, session
from autopilot.firmware.file import Wanted
from autopilot.firmware.journal import Journal, read_journal, write_journal
from autopilot.firmware.metadata import Marks
from autopilot.firmware.protocol import Target
from autopilot.firmware.upload import Change, Phase, Upload, Verdict, enabled_group
from autopilot.links.base import LinkError

INT8, REAL32 = 2, 9


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServedVehicle]:
    monkeypatch.setattr(session, "OTHERS_WAIT_S", 0.05)
    monkeypatch.setattr("autopilot.firmware.upload.SETTLE_S", 0.05)
    monkeypatch.setattr(session, "IDENTITY_WAIT_S", 0.05)
    monkeypatch.setenv("NORRBIN_STATE", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    vehicle = ServedVehicle(free_port())
    vehicle.vehicle.table = {f"P{number}": [float(number), REAL32] for number in range(9)}
    vehicle.start()
    yield vehicle
    vehicle.stop.set()
    vehicle.join()


def call(served: ServedVehicle, *words: str) -> int:
    parser = argparse.ArgumentParser()
    command.add_options(parser.add_subparsers().add_parser("params"))
    arguments = parser.parse_args(["params", *words, "--link", f"udpin:127.0.0.1:{served.address[1]}"])
    return int(arguments.run(arguments))


def values(served: ServedVehicle) -> list[float]:
    return [served.vehicle.table[f"P{number}"][0] for number in range(9)]


def write(name: str, **wanted: float) -> str:
    Path(name).write_text("".join(f"{key} {value}\n" for key, value in wanted.items()))
    return name


ALL_NEW = {f"P{number}": number + 0.5 for number in range(9)}
OLD = [float(number) for number in range(9)]
NEW = [number + 0.5 for number in range(9)]


def test_what_switches_on_is_set_first_and_what_switches_off_last() -> None:
    table: dict[str, tuple[float, int]] = {"A": (0.0, REAL32), "ON_ENABLE": (0, INT8), "OFF_ENABLE": (1, INT8)}
    vehicle = ParameterVehicle(table)
    order: list[str] = []
    plain_set = vehicle.set

    def noting_set(message: Any) -> None:
        order.append(message.param_id)
        plain_set(message)

    vehicle.set = noting_set  # type: ignore[method-assign]
    client = Upload(Target(1, 1), [Wanted(("OFF_ENABLE",), 0), Wanted(("A",), 1.0), Wanted(("ON_ENABLE",), 1)])
    lines = BadLink(1, 0.0), BadLink(2, 0.0)
    while not client.is_over:
        converse(client, vehicle, *lines, limit_s=60.0)
        client.proceed()
    assert order == ["ON_ENABLE", "A", "OFF_ENABLE"]
    assert enabled_group("BATT2_MONITOR") == "BATT2_"
    assert enabled_group("CRUISE_SPEED") is None


def test_what_a_switch_brings_into_being_is_kept_before_it_is_set() -> None:
    vehicle = ParameterVehicle({"GRP_ENABLE": (0, INT8)})
    vehicle.enables["GRP_ENABLE"] = {"GRP_GAIN": (1.0, REAL32)}
    client = Upload(Target(1, 1), [Wanted(("GRP_GAIN",), 2.5), Wanted(("GRP_ENABLE",), 1)])
    lines = BadLink(1, 0.0), BadLink(2, 0.0)
    converse(client, vehicle, *lines, limit_s=60.0)
    assert client.changes() == [Change("GRP_ENABLE", INT8, 0, 1)]
    client.proceed()
    converse(client, vehicle, *lines, limit_s=60.0)
    assert client.phase is Phase.COMPARED
    assert vehicle.table["GRP_GAIN"][0] == 1.0
    assert Change("GRP_GAIN", REAL32, 1.0, 2.5) in client.changes()
    client.proceed()
    converse(client, vehicle, *lines, limit_s=60.0)
    assert client.is_over
    assert vehicle.table["GRP_GAIN"][0] == 2.5


def test_a_parameter_that_another_one_changes_is_set_again() -> None:
    vehicle = ParameterVehicle({"A": (1.0, REAL32), "B": (1.0, REAL32)})
    vehicle.enables["B"] = {"A": (7.0, REAL32)}
    client = Upload(Target(1, 1), [Wanted(("A",), 1.0), Wanted(("B",), 2.0)])
    lines = BadLink(1, 0.0), BadLink(2, 0.0)
    while not client.is_over:
        converse(client, vehicle, *lines, limit_s=60.0)
        assert not client.is_over or {each.verdict for each in client.outcomes()} == {Verdict.SET}
        client.proceed()
    assert vehicle.table["A"][0] == 1.0


def test_a_constrained_value_takes_everything_back(served: ServedVehicle, capsys: pytest.CaptureFixture[str]) -> None:
    served.vehicle.limits["P4"] = (0.0, 4.25)
    assert call(served, "upload", write("new.parm", **ALL_NEW)) == 6
    captured = capsys.readouterr()
    assert "8 set, 1 constrained" in captured.out
    assert "vehicle 1 holds exactly the old values" in captured.err
    assert values(served) == OLD
    assert call(served, "restore") == 0
    assert "no upload was cut off" in capsys.readouterr().out


def test_keep_leaves_what_could_be_set(served: ServedVehicle) -> None:
    served.vehicle.limits["P4"] = (0.0, 4.25)
    assert call(served, "upload", write("new.parm", **ALL_NEW), "--on-failure", "keep") == 6
    assert values(served) == [*NEW[:4], 4.25, *NEW[5:]]
    assert call(served, "upload", write("more.parm", P0=9.0)) == 0


def test_an_unknown_name_is_found_before_anything_is_set(
    served: ServedVehicle, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(served, "upload", write("new.parm", P1=9.0, NOPE=1.0)) == 6
    captured = capsys.readouterr()
    assert "unknown: the vehicle never answered for this name" in captured.out
    assert "NOTHING WAS SET" in captured.err
    assert served.vehicle.sets_received == 0
    served.vehicle.says_errors = True
    assert call(served, "upload", "new.parm", "--on-failure", "keep") == 6
    assert served.vehicle.table["P1"][0] == 9.0


def test_an_armed_vehicle_is_refused_unless_set(served: ServedVehicle, capsys: pytest.CaptureFixture[str]) -> None:
    served.base_mode = dialect.MAV_MODE_FLAG_SAFETY_ARMED | 1
    with pytest.raises(RefusedError, match="is armed, or engaged, and parameters take effect at once; disarm"):
        call(served, "upload", write("new.parm", **ALL_NEW))
    assert served.vehicle.sets_received == 0
    assert call(served, "verify", "new.parm") == 6
    assert call(served, "upload", "new.parm", "--while-armed") == 0
    assert "is armed; parameters take effect at once" in capsys.readouterr().err


def test_a_vehicle_armed_while_it_is_written_to_is_reported(
    served: ServedVehicle, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = session.ParameterSession._wait

    def wait(self: session.ParameterSession) -> None:
        plain(self)
        if served.vehicle.sets_received >= 1:
            served.base_mode = dialect.MAV_MODE_FLAG_SAFETY_ARMED | 1

    monkeypatch.setattr(session.ParameterSession, "_wait", wait)
    assert call(served, "upload", write("new.parm", **ALL_NEW)) == 0
    assert values(served) == NEW
    assert "vehicle 1 was armed while parameters were being written" in capsys.readouterr().err


@pytest.mark.parametrize("words", [("upload", "second.parm"), ("restore",), ("restore", "second.parm")])
def test_two_that_write_to_one_vehicle_do_not_mix(
    served: ServedVehicle, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second one would find the first one's journal, take it for one that was cut off, and undo it meanwhile."""
    write("second.parm", **dict.fromkeys(ALL_NEW, 77.0))
    said: list[str] = []
    plain = params_upload.carry_out

    def meanwhile(*arguments: Any) -> None:
        with pytest.raises(RefusedError, match="another autopilot params is writing to vehicle 1 just now; wait"):
            call_beside(served, *words)
        said.append("refused")
        plain(*arguments)

    def call_beside(served: ServedVehicle, *words: str) -> None:
        vehicle = session.Vehicle(1, 1, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, dialect.MAV_TYPE_SURFACE_BOAT, False)
        double = BesideSession(vehicle)
        monkeypatch.setattr(params_upload, "opened_session", lambda *_: double)
        monkeypatch.setattr(params_upload, "own_marks", lambda _: Marks())
        call(served, *words)

    monkeypatch.setattr(params_upload, "carry_out", meanwhile)
    assert call(served, "upload", write("new.parm", **ALL_NEW)) == 0
    assert said == ["refused"]
    assert values(served) == NEW


class BesideSession:
    """A second session with the same vehicle, over a line of its own; it must not come to speaking."""

    def __init__(self, vehicle: session.Vehicle) -> None:
        self.vehicle = vehicle

    def __enter__(self) -> BesideSession:
        return self

    def __exit__(self, *_: object) -> None:
        return


def stop_after(served: ServedVehicle, sets: int, monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    """Let the loop end with `error` after so many sets, once."""
    plain = session.ParameterSession._wait
    pending = [error]

    def wait(self: session.ParameterSession) -> None:
        plain(self)
        if served.vehicle.sets_received >= sets and pending:
            raise pending.pop()

    monkeypatch.setattr(session.ParameterSession, "_wait", wait)


def test_ctrl_c_puts_the_old_values_back(
    served: ServedVehicle, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stop_after(served, 3, monkeypatch, KeyboardInterrupt())
    assert call(served, "upload", write("new.parm", **ALL_NEW)) == params_upload.INTERRUPTED
    assert "holds exactly the old values" in capsys.readouterr().err
    assert values(served) == OLD


def test_a_lost_link_leaves_a_journal_that_restore_finishes(
    served: ServedVehicle, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stop_after(served, 3, monkeypatch, LinkError("link 'x': vehicle 1 has been silent for 10 s."))
    with pytest.raises(LinkError, match=r"has been silent for 10 s\. First run: autopilot params restore --link udpin"):
        call(served, "upload", write("new.parm", **ALL_NEW))
    assert "NOT FINISHED" in capsys.readouterr().out
    with pytest.raises(RefusedError, match=r"the upload of new\.parm to vehicle 1 .* was cut off, so that it may hold"):
        call(served, "upload", "new.parm")
    assert call(served, "restore", "--to", "new") == 0
    assert values(served) == NEW
    assert call(served, "upload", "new.parm") == 0


def test_where_the_old_values_of_a_cut_upload_are_is_said_in_any_folder(
    served: ServedVehicle, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    stop_after(served, 3, monkeypatch, LinkError("link 'x': vehicle 1 has been silent for 10 s."))
    with pytest.raises(LinkError):
        call(served, "upload", write("new.parm", **ALL_NEW), "--backup", "old.yaml")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert call(served, "restore", "--to", "as-is") == 0
    assert f"the old values are in {tmp_path / 'old.yaml'}" in capsys.readouterr().out


def test_restore_with_a_file_uploads_it(served: ServedVehicle, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(served, "upload", write("new.parm", **ALL_NEW), "--backup", "old.yaml", "--json") == 0
    assert json.loads(capsys.readouterr().out)["backup"] == "old.yaml"
    assert call(served, "restore", "old.yaml") == 0
    assert values(served) == OLD
    with pytest.raises(InputError, match="--to chooses a side of an upload that was cut off"):
        call(served, "restore", "old.yaml", "--to", "old")


def test_a_journal_of_another_board_is_not_restored(served: ServedVehicle, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = Journal("new.parm", "yesterday", 1, "ardurover", "beef", "", (Change("P1", REAL32, 5.0, 6.0),))
    path = Path("state") / "upload-1-1.json"
    write_journal(path, journal)
    assert read_journal(path) == journal
    monkeypatch.setattr(session.ParameterSession, "identify", lambda self: session.Identity("cafe", ""))
    with pytest.raises(RefusedError, match=r"went to another board \(beef\) than this one \(cafe\)"):
        call(served, "restore")
    assert served.vehicle.sets_received == 0


@pytest.mark.parametrize("text", ["{", "[]", '{"format": 9}', '{"format": 1, "changes": [{"name": 1}]}', "\udcff"])
def test_a_damaged_journal_is_one_sentence(served: ServedVehicle, text: str) -> None:
    path = Path("state") / "upload-1-1.json"
    path.parent.mkdir()
    path.write_text(text, encoding="utf-8", errors="surrogateescape")
    with pytest.raises(InputError, match=r"upload-1-1\.json: this journal of an upload cannot be used \(") as caught:
        call(served, "restore")
    assert "\n" not in str(caught.value)
    assert "remove it, then restore" in str(caught.value)
    path.unlink()
    assert call(served, "restore", write("backup.parm", **ALL_NEW)) == 0


def test_a_journal_that_cannot_be_kept_stops_the_upload(
    served: ServedVehicle, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NORRBIN_STATE", str(tmp_path / "file" / "state"))
    with pytest.raises(InputError, match="Name another folder in the environment variable NORRBIN_STATE"):
        call(served, "upload", write("new.parm", **ALL_NEW), "--no-backup")
    assert served.vehicle.sets_received == 0


def test_without_a_home_an_upload_asks_for_a_folder(served: ServedVehicle, monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for name in ("NORRBIN_STATE", "XDG_STATE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    with pytest.raises(InputError, match=r"Could not determine home directory.*NORRBIN_STATE"):
        call(served, "upload", write("new.parm", **ALL_NEW), "--no-backup")
    assert served.vehicle.sets_received == 0


def test_a_journal_on_a_full_disk_says_whose_disk_and_what_to_do(
    served: ServedVehicle, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(journal, "replace_file", full)
    words = (
        r"state: cannot be written into \(No space left on device\); the old values are kept there, .* Free the disk"
    )
    with pytest.raises(InputError, match=words):
        call(served, "upload", write("new.parm", **ALL_NEW), "--no-backup")
    assert served.vehicle.sets_received == 0


def test_integers_beyond_a_float_are_refused_before_they_are_rounded() -> None:
    vehicle = ParameterVehicle({"MASK": (1, 6)})
    client = Upload(Target(1, 1), [Wanted(("MASK",), 16_777_217)])
    converse(client, vehicle, BadLink(1, 0.0), BadLink(2, 0.0), limit_s=60.0)
    outcome = client.outcomes()[0]
    assert outcome.verdict is Verdict.REJECTED
    assert outcome.reason == "integers travel to it as 32-bit floats, which hold 16777216 but not 16777217"


def test_a_new_system_id_is_refused(served: ServedVehicle) -> None:
    served.vehicle.table["SYSID_THISMAV"] = [1, 4]
    assert call(served, "upload", write("same.parm", SYSID_THISMAV=1, P1=4.0)) == 0
    with pytest.raises(RefusedError, match="changes SYSID_THISMAV from 1 to 7: the vehicle would be another one"):
        call(served, "upload", write("new.parm", SYSID_THISMAV=7, P1=9.0))
    assert served.vehicle.table["P1"][0] == 4.0


def test_a_disk_that_fills_up_on_the_way_takes_everything_back(
    served: ServedVehicle, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    served.vehicle.table["GRP_ENABLE"] = [0, INT8]
    served.vehicle.enables["GRP_ENABLE"] = {"GRP_GAIN": (1.0, REAL32)}
    served.vehicle.says_errors = True
    plain, calls = params_upload.write_journal, []

    def fail_the_second_time(path: Path, journal: Journal) -> None:
        calls.append(len(journal.changes))
        if len(calls) == 2:
            raise InputError("state: cannot be written (No space left on device).")
        plain(path, journal)

    monkeypatch.setattr(params_upload, "write_journal", fail_the_second_time)
    with pytest.raises(InputError, match="No space left on device"):
        call(served, "upload", write("new.parm", GRP_GAIN=2.5, GRP_ENABLE=1), "--no-backup")
    assert calls == [1, 2]
    assert "holds exactly the old values" in capsys.readouterr().err
    assert (served.vehicle.table["GRP_ENABLE"][0], served.vehicle.table["GRP_GAIN"][0]) == (0, 1.0)


@pytest.mark.parametrize("content", ["[" * 100_000, None], ids=["deep", "pipe"])
def test_a_journal_that_is_none_is_refused_and_holds_nothing_up(tmp_path: Path, content: str | None) -> None:
    path = tmp_path / "journal.json"
    if content is None:
        os.mkfifo(path)
    else:
        path.write_text(content)
    with pytest.raises(InputError, match=r"journal\.json"):
        read_journal(path)
