"""The service that is installed: what systemd makes of it, what is kept, what is refused."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from autopilot.cli.install_service import Service, adapter_of, rules_text, unit_text
from autopilot.cli.main import build_parser, main
from autopilot.errors import InputError
from autopilot.vessel.file import dump_vessel, load_vessel

INSTALL = ["install-service", "lanxin", "--link", "serial:/dev/pixhawk:115200", "--run-with=--as-gcs"]
ADAPTERS = ["--adapter", "pixhawk=FT6A2B", "--adapter", "compass=port:1-1.2"]
FILES = {
    "etc/systemd/system/norrbin.service",
    "etc/sysusers.d/norrbin.conf",
    "etc/udev/rules.d/70-norrbin.rules",
    "var/lib/norrbin/boat.yaml",
}


def files_below(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*") if path.is_file()}


def settings_of(unit: str) -> dict[str, str]:
    lines = [line.partition("=") for line in unit.splitlines() if "=" in line and not line.startswith("#")]
    return {key: value for key, _, value in lines}


def test_installed_and_removed_again_below_a_root(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*INSTALL, *ADAPTERS, "--root", str(tmp_path)]) == 0
    assert files_below(tmp_path) == FILES
    assert main(["install-service", "--uninstall", "--root", str(tmp_path)]) == 0
    assert files_below(tmp_path) == {"var/lib/norrbin/boat.yaml"}
    assert "left" in capsys.readouterr().out
    assert main(["install-service", "--uninstall", "--root", str(tmp_path)]) == 0
    assert "nothing was installed" in capsys.readouterr().out


def test_a_dry_run_prints_what_would_be_written_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*INSTALL, *ADAPTERS, "--root", str(tmp_path), "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert files_below(tmp_path) == set()
    assert main([*INSTALL, *ADAPTERS, "--root", str(tmp_path)]) == 0
    for path in FILES - {"var/lib/norrbin/boat.yaml"}:
        assert f"# /{path}\n{(tmp_path / path).read_text()}" in said


def test_a_vessel_file_that_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = tmp_path / "var/lib/norrbin/boat.yaml"
    kept.parent.mkdir(parents=True)
    kept.write_text("tuned for weeks")
    assert main([*INSTALL, "--root", str(tmp_path)]) == 0
    assert kept.read_text() == "tuned for weeks"
    assert f"kept {kept}: remove it first" in capsys.readouterr().out


def test_a_vessel_file_in_another_encoding_is_installed_as_utf_8(tmp_path: Path) -> None:
    text = dump_vessel(load_vessel("lanxin"))
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-16")
    source = ["install-service", str(tmp_path / "mine.yaml"), *INSTALL[2:]]
    assert main([*source, "--root", str(tmp_path)]) == 0
    assert (tmp_path / "var/lib/norrbin/boat.yaml").read_text(encoding="utf-8") == text


def test_the_unit_feeds_a_watchdog_restarts_and_runs_as_an_ordinary_user(tmp_path: Path) -> None:
    assert main([*INSTALL, "--root", str(tmp_path), "--watchdog-s", "8", "--user", "skipper"]) == 0
    unit = settings_of((tmp_path / "etc/systemd/system/norrbin.service").read_text())
    assert (unit["Type"], unit["WatchdogSec"], unit["Restart"], unit["User"]) == (
        "notify",
        "8",
        "on-failure",
        "skipper",
    )
    assert unit["StartLimitIntervalSec"] == "0"
    assert float(unit["RestartSec"].removesuffix("ms")) < 500
    command = shlex.split(unit["ExecStart"])
    assert command[1:4] == ["-m", "autopilot", "run"]
    steering = build_parser(command[3:]).parse_args(command[3:])
    assert steering.link == ["serial:/dev/pixhawk:115200"]
    assert steering.as_gcs
    assert steering.wait == 0.0
    assert steering.realtime <= int(unit["LimitRTPRIO"])
    assert steering.log_dir == Path("/var/log/norrbin")


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
def test_systemd_finds_nothing_wrong(tmp_path: Path) -> None:
    assert main([*INSTALL, *ADAPTERS, "--root", str(tmp_path)]) == 0
    unit = tmp_path / "etc/systemd/system/norrbin.service"
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(unit)], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(shutil.which("systemd-sysusers") is None, reason="needs systemd-sysusers")
def test_the_user_can_be_made(tmp_path: Path) -> None:
    assert main([*INSTALL, "--root", str(tmp_path)]) == 0
    conf = tmp_path / "etc/sysusers.d/norrbin.conf"
    done = subprocess.run(
        ["systemd-sysusers", "--dry-run", f"--root={tmp_path}", str(conf)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "norrbin" in done.stdout + done.stderr


def test_adapters_are_named_by_serial_number_or_port() -> None:
    service = Service("norrbin", "norrbin", (), (adapter_of("pixhawk=FT6A2B"), adapter_of("compass=port:1-1.2")))
    first, second = rules_text(service).splitlines()[1:]
    assert first.startswith('SUBSYSTEM=="tty", ATTRS{serial}=="FT6A2B", SYMLINK+="pixhawk", ')
    assert second.startswith('SUBSYSTEM=="tty", KERNELS=="1-1.2", SYMLINK+="compass", ')


def test_words_that_systemd_would_read_otherwise_are_quoted() -> None:
    unit = unit_text(Service("norrbin", "norrbin", ("/opt/my boat/python", "%n", "$HOME", 'a"b', "back\\slash")))
    assert 'ExecStart="/opt/my boat/python" "%%n" "$$HOME" "a\\"b" "back\\\\slash"\n' in unit
    with pytest.raises(InputError, match="control characters"):
        unit_text(Service("norrbin", "norrbin", ("a\nExecStartPre=/bin/sh",)))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["install-service"], "give the vessel file and at least one --link"),
        (["install-service", "lanxin", "--link", "serial:/dev/x"], "write it like serial:"),
        (["install-service", "nowhere.yaml", "--link", "udpin:127.0.0.1:1", "--root", "/tmp/none"], "nowhere.yaml"),
        ([*INSTALL, "--name", "../evil"], "a name of up to 31 small letters"),
        ([*INSTALL, "--user", "root;"], "a name of up to 31 small letters"),
        ([*INSTALL, "--adapter", "x"], "write a name of small letters and digits, =, and the USB serial number"),
        ([*INSTALL, "--adapter", 'x=A"B'], "is no USB serial number"),
        ([*INSTALL, "--adapter", "x=port:usb1"], "a USB port is written like port:1-1.2"),
        ([*INSTALL, "--watchdog-s", "1"], "--watchdog-s 1: allowed is 3 to 600"),
    ],
)
def test_impossible_service_options_are_refused_in_one_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(arguments if "--root" in arguments else [*arguments, "--root", "/nowhere/to/write"])
    said = capsys.readouterr().err
    assert code in (2, 3)
    assert sentence in said
    assert said.count("\n") == 1


def test_an_option_that_run_does_not_know_is_found_now(tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*INSTALL, "--run-with=--no-such-thing", "--root", str(tmp_path)])
    assert ended.value.code == 2
    assert files_below(tmp_path) == set()


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "var").write_text("a file where a folder must be")
    assert main([*INSTALL, "--root", str(tmp_path)]) == 2
    assert "run it as root (sudo), or below another folder with --root" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("vessel", "more"),
    [
        ("lanxin", "--link updin:127.0.0.1:1"),
        ("no-such.yaml", ""),
        ("lanxin_paper_gains", "--engage 90"),
        ("lanxin", "--no"),
    ],
)
def test_a_mistake_in_the_configuration_is_not_restarted(vessel: str, more: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "autopilot", "run", vessel, "--link", "udpin:127.0.0.1:0", "--wait", "0"]
    ended = subprocess.run(
        [*command, *more.split()], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    unit = settings_of(unit_text(Service("norrbin", "norrbin", ())))
    assert str(ended.returncode) in unit["RestartPreventExitStatus"].split(), ended.stderr
