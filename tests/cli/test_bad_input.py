"""Logs that are none, and slips on the command line: one sentence that names what was wrong, exit code 2."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from autopilot import __version__
from autopilot.cli.main import main
from autopilot.cli.web import PageOfSteps
from autopilot.links.url import open_transport
from autopilot.vessel.file import dump_vessel, load_vessel
from sitl.cli import main as sitl_main


def complaint(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(arguments) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    return lines[0]


@pytest.mark.parametrize("command", ["replay", "identify"])
@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"", "empty"),
        (b"this is no log at all, but it is long enough to be one", "no MAVLink packet at byte"),
        (bytes(100), "no MAVLink packet at byte"),
    ],
    ids=["empty", "text", "zeros"],
)
def test_a_log_that_is_none_is_one_sentence(
    tmp_path: Path, command: str, content: bytes, part: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wrong.tlog"
    path.write_bytes(content)
    said = complaint(capsys, command, str(path))
    assert "wrong.tlog" in said
    assert part in said


@pytest.mark.parametrize("command", ["replay", "identify"])
def test_a_log_that_is_not_there_or_a_folder_is_one_sentence(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = complaint(capsys, command, str(tmp_path / "none.tlog"))
    assert "none.tlog: No such file" in said
    folder = tmp_path / "folder.tlog"
    folder.mkdir()
    assert "folder.tlog: Is a directory" in complaint(capsys, command, str(folder))


@pytest.mark.parametrize(
    "command",
    [
        ["log", "info", "PATH"],
        ["gains", "PATH.yaml"],
        ["gains", "lanxin", "--out", "PATH.yaml"],
        ["log", "csv", "PATH", "--out", "PATH"],
        ["params", "check", "PATH"],
        ["run", "PATH", "--link", "udpin:127.0.0.1:0"],
        ["identify", "PATH", "PATH2"],
    ],
    ids=" ".join,
)
def test_a_path_that_cannot_be_looked_at_is_one_sentence(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    long = complaint(capsys, *(word.replace("PATH", "p" * 5000) for word in command))
    assert "File name too long" in long and len(long) < 1000
    closed, owner = tmp_path / "closed", os.geteuid()
    closed.mkdir()
    closed.chmod(0)
    if owner == 0:  # to whom nothing is closed
        os.seteuid(65534)
    try:
        assert "Permission denied" in complaint(capsys, *(word.replace("PATH", str(closed / "x")) for word in command))
    finally:
        os.seteuid(owner)


def test_a_shipped_file_of_another_kind_is_named_so(capsys: pytest.CaptureFixture[str]) -> None:
    said = complaint(capsys, "gains", "ardurover-boat")
    assert "a shipped file of another kind (firmware)" in said and "lanxin" in said


def test_a_vessel_file_in_place_of_a_scenario_is_named_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "boat.yaml"
    file.write_text(dump_vessel(load_vessel("lanxin")))
    assert sitl_main(["serve", "lanxin", "--scenario", str(file), "--duration", "1"]) == 2
    assert "update Norrbin, or give a scenario" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["verify", "FILE", "--link"], ["diff", "FILE"]], ids=" ".join)
def test_a_file_with_a_mistake_costs_no_wait_for_a_vehicle(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "boat.yaml"
    file.write_text(dump_vessel(load_vessel("lanxin")).replace("angle_max_deg", "angle_mx_deg"))
    words = [word.replace("FILE", str(file)) for word in command]
    # nothing sends there: a link that is opened ends with exit code 3
    assert "did you mean angle_max_deg?" in complaint(capsys, "params", *words, "udpin:127.0.0.1:0")


def test_a_mistake_in_a_new_boat_s_file_is_named_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "boat.yaml"
    file.write_text(dump_vessel(load_vessel("lanxin")).replace("angle_max_deg", "angle_mx_deg"))
    assert main(["new-boat", str(file)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and "did you mean angle_max_deg?" in err


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "COMMAND"),
        (["completion"], "bash, zsh, fish"),
        (["sail"], "'sail'"),
        (["run", "lanxin"], "--link"),
        (["run", "lanxin", "--link", "udpin:127.0.0.1:0", "--law", "magic"], "'magic'"),
        (["trial", "lanxin"], "'lanxin'"),
    ],
)
def test_bad_usage_ends_with_what_was_wrong(
    arguments: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(arguments)
    assert left.value.code == 2
    first, *_, last = capsys.readouterr().err.strip().splitlines()
    assert first.startswith("autopilot")
    assert named in first
    assert last.startswith("Options and explanations: autopilot") and last.endswith("--help")


@pytest.mark.parametrize("program", [main, sitl_main])
def test_version_is_that_of_the_package(program, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        program(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"norrbin {__version__}\n"


def test_help_lists_the_commands_and_the_exit_codes(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["--help"])
    assert left.value.code == 0
    text = capsys.readouterr().out
    for word in ("run", "trial", "identify", "gains", "params", "replay", "demo", "exit codes:"):
        assert word in text


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    """Return exit code and sentence of `autopilot run`."""
    code = main(["run", *arguments])
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("autopilot: ")
    return code, line


@pytest.mark.parametrize(
    ("arguments", "code", "parts"),
    [
        (["nowhere.yaml", "--link", "udpin:127.0.0.1:0"], 2, ["nowhere.yaml"]),
        (["lanxin", "--link", "carrier-pigeon:7"], 2, ["carrier-pigeon"]),
        (["lanxin", "--link-wait", "0", "--link", "serial:/dev/not-there:115200"], 3, ["/dev/not-there"]),
        (["lanxin", "--link-wait", "0", "--link", "tcp:127.0.0.1:1"], 3, ["tcp:127.0.0.1:1"]),
        (["lanxin", "--link", "udpin:127.0.0.1:0", "--engage", "400"], 2, ["400", "0 to 360"]),
        (["lanxin", "--link", "udpin:127.0.0.1:0", "--engage", "north"], 2, ["north"]),
        (["lanxin", "--link", "udpin:127.0.0.1:0", "--duration", "-1"], 2, ["--duration"]),
        (["lanxin", "--link", "udpout:127.0.0.1:9", "--log", "/proc/no/run.tlog"], 2, ["/proc/no/run.tlog"]),
    ],
)
def test_a_run_with_bad_input_is_one_sentence(
    arguments: list[str], code: int, parts: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    found, line = run(capsys, *arguments)
    assert found == code
    assert all(part in line for part in parts), line


def test_unknown_keys_and_wrong_units_name_the_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = dump_vessel(load_vessel("lanxin"))
    for wrong, right in (
        ("rate_max_rad_s: 20.0", "rate_max_deg_s: 20.0"),
        ("rate_max_deg: 20.0", "rate_max_deg_s: 20.0"),
    ):
        path = tmp_path / "boat.yaml"
        path.write_text(text.replace(right, wrong))
        code, line = run(capsys, str(path), "--link", "udpin:127.0.0.1:0")
        assert code == 2
        assert all(part in line for part in ("boat.yaml", "line", wrong.split(":")[0])), line


SLIPS = {
    "identify zigzag.log": "did you mean zigzag.tlog?",
    "gains my-boot.yaml": "did you mean my-boat.yaml?",
    "identify my-boat.yaml": "is a file of parameters, no log, which is not read; give the log of a run",
    "gains zigzag.tlog": "is no text; a file of parameters (YAML) is needed",
    "replay my-boat.yaml": "give one that `autopilot run --log` has written",
    "run my-boat.yaml --link /dev/ttyUSB0": "write serial:/dev/ttyUSB0:57600 for MAVLink, nmea:/dev/ttyUSB0:4800 for",
    "run my-boat.yaml --link 127.0.0.1:14550": "write udpin:127.0.0.1:14550, udpout:127.0.0.1:14550 or tcp:",
    "run my-boat.yaml --link udpin:127.0.0.1:0 --engage north": "--engage north: needed are degrees from 0 to 360",
    "gains my-boat.yaml --report x.pdf": "write x.html, which a browser prints as PDF",
}


@pytest.mark.parametrize("typed", SLIPS)
def test_a_newcomers_slip_is_answered_with_what_to_write(
    tmp_path: Path, typed: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("zigzag.tlog").write_bytes(b"\0\1\2\3\4\5\6\7\xfd" + bytes(40))
    Path("my-boat.yaml").write_text(dump_vessel(load_vessel("lanxin")))
    assert main(typed.split()) in (2, 3)
    assert SLIPS[typed] in capsys.readouterr().err


def test_where_a_command_is_missing_the_commands_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["trial"])
    assert "missing: TRIAL; there are zigzag, turning" in capsys.readouterr().err


def test_what_is_wrong_with_a_place_is_said_in_words_that_fit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    run = ["run", "lanxin", "--link", "udpout:127.0.0.1:9", "--wait", "1"]
    web = ["web", "--link", "udpout:127.0.0.1:9", "--listen", "127.0.0.1:0"]
    service = ["--link", "udpin:127.0.0.1:14550", "--dry-run"]
    for arguments, part in (
        ([*run, "--log-dir", "/proc"], "log folder /proc: nothing can be kept there"),
        ([*run, "--log", "/proc/run.tlog"], "log /proc/run.tlog: nothing can be kept there"),
        ([*run, "--log-dir", "file"], "log folder file: a file of that name is there"),
        ([*run, "--state", "folder"], "folder: is a folder"),
        ([*run, "--state", "none/note"], "none/note: cannot be written"),
        ([*run, "--log-total-mb", "5"], "--log-total-mb goes with --log-dir"),
        ([*run, "--log-dir", ""], "an argument is empty"),
        ([*run, "--log-dir="], "an argument is empty"),
        ([*web, "--boat", "none/boat.yaml"], "none/boat.yaml: cannot be written"),
        ([*web, "--boat", "folder"], "folder: is a folder"),
        ([*web, "--token-file", "folder"], "--token-file folder: Is a directory"),
        ([*web, "--cert", "folder"], "--cert folder: is no file"),
        (["install-service", "none.yaml", *service], "none.yaml: no such file"),
        (["install-service", "folder", *service], "folder: neither a file nor shipped"),
        (["demo", "--out", "/proc/demo", "--no-report"], "--out /proc/demo: nothing can be kept there"),
    ):
        assert part in complaint(capsys, *arguments), arguments
    for arguments in (["envelope", "lanxin", "--runs", "1"], ["campaign", "front", "--runs", "1"]):
        assert sitl_main([*arguments, "--report", "folder"]) == 2
        assert capsys.readouterr().err == "sitl: folder: is a folder; give the name of a file.\n"
    assert [path.name for path in tmp_path.iterdir() if path.name not in ("file", "folder")] == []


def test_what_ends_in_an_equals_sign_is_not_empty(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    said = complaint(capsys, "log", "csv", str(tmp_path / "none.tlog"), f"--out={tmp_path}/a=")
    assert "none.tlog" in said and "an argument is empty" not in said


def test_a_folder_of_which_all_names_are_taken_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("autopilot.files.saving.MOST_NUMBERS", 3)
    for name in ("demo", "demo-2"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "kept").touch()
    said = complaint(capsys, "demo", "--out", str(tmp_path / "demo"), "--no-report")
    assert f"{tmp_path}/demo: is not empty, and all names beside it are taken" in said


def test_a_boat_that_is_not_there_yet_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    PageOfSteps(tmp_path / "boat.yaml").check()
    assert f"{tmp_path}/boat.yaml is not there yet" in capsys.readouterr().out
    (tmp_path / "boat.yaml").write_text("name: mine")
    PageOfSteps(tmp_path / "boat.yaml").check()
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("scheme", ["udpin", "tcpin", "nmea-tcpin"])
def test_a_port_that_the_system_has_chosen_is_said(scheme: str, capsys: pytest.CaptureFixture[str]) -> None:
    transport = open_transport(f"{scheme}:127.0.0.1:0")
    port = transport.port  # type: ignore[attr-defined]
    transport.close()
    assert capsys.readouterr().err == f"link '{scheme}:127.0.0.1:0' listens at port {port}\n"
    open_transport(f"{scheme}:127.0.0.1:{port}").close()
    assert capsys.readouterr().err == ""


def test_a_full_disk_ends_the_demo_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> object:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("autopilot.runtime.log_files.create_unused", full)
    said = complaint(capsys, "demo", "--out", str(tmp_path / "demo"), "--no-report")
    assert said == "autopilot: demo leg trial: log stopped: No space left on device; free the disk, or log elsewhere"
