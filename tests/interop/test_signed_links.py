"""Simulated flight controller, pilot and parameter tool as processes that share a signing key, or do not."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
from two_processes import free_port, patient_vessel, simulator

from autopilot.cli.main import main

PASSPHRASE = "correct horse battery staple"
SPEEDUP = 2


@pytest.fixture
def key(tmp_path: Path) -> Path:
    path = tmp_path / "signing.key"
    path.write_text(PASSPHRASE + "\n")
    path.chmod(0o600)
    return path


def autopilot(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "autopilot", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, stdin=subprocess.DEVNULL)
    assert "Traceback" not in done.stderr, done.stderr
    assert PASSPHRASE not in done.stdout + done.stderr
    return done


def run(vessel: Path, port: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    return autopilot(
        "run", str(vessel), "--link", f"udpin:127.0.0.1:{port}", "--as-gcs", "--engage", "60",
        "--speedup", str(SPEEDUP), *arguments,
    )  # fmt: skip


def test_a_vehicle_with_another_key_is_not_heard_and_the_reason_is_said(tmp_path: Path, key: Path) -> None:
    vessel, port, other = patient_vessel(tmp_path), free_port(), tmp_path / "other.key"
    other.write_text("another passphrase\n")
    other.chmod(0o600)
    with simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--signing-key", str(other)):
        done = run(vessel, port, "--wait", "3", "--signing-key", str(key))
    assert done.returncode == 3
    assert "signed with another key: use the same key on both sides, or none" in done.stderr


def test_a_vehicle_with_a_key_does_not_obey_one_without(tmp_path: Path, key: Path) -> None:
    """It is seen, for its own messages can be read, but it takes no command: the helm stays refused."""
    vessel, port = patient_vessel(tmp_path), free_port()
    with simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--signing-key", str(key)):
        done = run(vessel, port, "--duration", "6")
    assert done.returncode in (3, 4), done.stdout


def test_parameters_over_a_signed_link(tmp_path: Path, key: Path) -> None:
    port, firmware = free_port(), tmp_path / "one.yaml"
    firmware.write_text(
        "schema_version: 2\nfirmware: ardurover\nframe: boat\nchecked_with: []\ngroups:\n  radio:\n    doc: trim\n"
        "    parameters:\n      RC1_TRIM: {value: 1510, doc: moved}\n"
    )
    with simulator(1, "--mavlink", f"udpout:127.0.0.1:{port}", "--signing-key", str(key)):
        link = ("--link", f"udpin:127.0.0.1:{port}", "--signing-key", str(key))
        done = autopilot("params", "upload", str(firmware), "--no-backup", "--while-armed", "--json", *link)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(done.stdout)["parameters"]
    assert (row["name"], row["old"], row["now"]) == ("RC1_TRIM", 1500, 1510)


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "lanxin", "--link", "udpin:127.0.0.1:0"],
        ["trial", "zigzag", "lanxin", "--link", "udpin:127.0.0.1:0"],
        ["params", "diff", "ardurover-boat", "udpin:127.0.0.1:0"],
        ["params", "restore", "--link", "udpin:127.0.0.1:0"],
    ],
)
def test_a_key_file_that_others_may_read_ends_every_command(
    arguments: list[str], key: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key.chmod(0o644)
    assert main([*arguments, "--signing-key", str(key)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == f"autopilot: signing key {key}: others may use it (mode 0644); run: chmod 600 {key}\n"


def test_timestamps_are_kept_beside_the_key_and_go_on_after_a_kill(tmp_path: Path, key: Path) -> None:
    vessel, port = patient_vessel(tmp_path), free_port()
    file, kept = key.with_name("signing.key.timestamp"), []
    for _ in range(2):
        command = [sys.executable, "-m", "autopilot", "run", str(vessel), "--link", f"udpin:127.0.0.1:{port}"]
        with subprocess.Popen([*command, "--signing-key", str(key)], stdin=subprocess.DEVNULL) as process:
            before = file.read_text() if file.exists() else ""
            until = time.monotonic() + 60.0
            while not file.exists() or file.read_text() == before:
                assert time.monotonic() < until
                time.sleep(0.05)
            process.kill()
        kept.append(int(file.read_text()))
    assert kept[1] > kept[0]
