"""Simulated flight controller, pilot and parameter tool as processes that share a signing key, or do not."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from two_processes import free_port, patient_vessel, simulator

from autopilot.loop.record import read_log, read_packets
from autopilot.loop.replay import replay
from autopilot.signals import Mode

PASSPHRASE = "correct horse battery staple"
SPEEDUP = 3


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


def test_a_heading_is_held_over_a_signed_link_and_the_log_holds_no_signature(tmp_path: Path, key: Path) -> None:
    vessel, port, log = patient_vessel(tmp_path), free_port(), tmp_path / "run.tlog"
    with simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--signing-key", str(key)):
        done = run(vessel, port, "--duration", "18", "--log", str(log), "--signing-key", str(key))
    assert done.returncode == 0, done.stderr
    ticks = read_log(log).ticks
    assert ticks[-1].mode is Mode.ENGAGED and abs(ticks[-1].state.heading - 1.047) < 0.05
    assert replay(log).identical
    content = log.read_bytes()
    assert hashlib.sha256(PASSPHRASE.encode()).digest() not in content and PASSPHRASE.encode() not in content
    packets = [packet for _, packet in read_packets(log)]
    kinds = {dialect.MAVLink(None).decode(bytearray(packet)).get_type() for packet in packets}
    assert {"ATTITUDE", "RC_CHANNELS_OVERRIDE", "HEARTBEAT", "PARAM_VALUE"} <= kinds
    assert not any(packet[0] == 0xFD and packet[2] & 1 for packet in packets)


@pytest.mark.parametrize("vehicle_signs", [False, True])
def test_a_vehicle_without_our_key_is_not_heard_and_the_reason_is_said(
    tmp_path: Path, key: Path, vehicle_signs: bool
) -> None:
    vessel, port = patient_vessel(tmp_path), free_port()
    other = tmp_path / "other.key"
    other.write_text("another passphrase\n")
    other.chmod(0o600)
    options = ["--signing-key", str(other)] if vehicle_signs else []
    with simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", *options):
        done = run(vessel, port, "--wait", "3", "--signing-key", str(key))
    assert done.returncode == 3
    reason = "signed with another key" if vehicle_signs else "not signed"
    assert f"{reason}: use the same key on both sides, or none" in done.stderr


def test_a_vehicle_with_a_key_does_not_obey_one_without(tmp_path: Path, key: Path) -> None:
    """It is seen, for its own messages can be read, but it takes no command: the helm stays refused."""
    vessel, port = patient_vessel(tmp_path), free_port()
    with simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--signing-key", str(key)):
        done = run(vessel, port, "--duration", "12")
    assert done.returncode in (3, 4), done.stdout


def test_parameters_over_a_signed_link(tmp_path: Path, key: Path) -> None:
    port, firmware = free_port(), tmp_path / "two.yaml"
    with simulator(1, "--mavlink", f"udpout:127.0.0.1:{port}", "--signing-key", str(key)):
        link = ("--link", f"udpin:127.0.0.1:{port}", "--signing-key", str(key))
        done = autopilot("params", "download", str(firmware), "--names", "RC1_TRIM,RC_OVERRIDE_TIME", *link)
        assert done.returncode == 0, done.stderr
        firmware.write_text(firmware.read_text().replace("1500", "1510"))
        done = autopilot("params", "upload", str(firmware), "--no-backup", "--while-armed", "--json", *link)
        assert done.returncode == 0, done.stderr
        rows = {row["name"]: row["now"] for row in json.loads(done.stdout)["parameters"]}
        assert rows["RC1_TRIM"] == 1510


def test_a_key_file_that_others_may_read_ends_every_command(tmp_path: Path, key: Path) -> None:
    key.chmod(0o644)
    vessel = patient_vessel(tmp_path)
    for arguments in (
        ("run", str(vessel), "--link", "udpin:127.0.0.1:0"),
        ("trial", "zigzag", str(vessel), "--link", "udpin:127.0.0.1:0"),
        ("params", "diff", "ardurover-boat", "udpin:127.0.0.1:0"),
    ):
        done = autopilot(*arguments, "--signing-key", str(key))
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == f"autopilot: signing key {key}: others may use it (mode 0644); run: chmod 600 {key}\n"


def test_timestamps_are_kept_beside_the_key_and_go_on_after_a_kill(tmp_path: Path, key: Path) -> None:
    vessel, port = patient_vessel(tmp_path), free_port()
    file, kept = key.with_name("signing.key.timestamp"), []
    for _ in range(2):
        command = [sys.executable, "-m", "autopilot", "run", str(vessel), "--link", f"udpin:127.0.0.1:{port}"]
        with subprocess.Popen([*command, "--signing-key", str(key)], stdin=subprocess.DEVNULL) as process:
            before = file.read_text() if file.exists() else ""
            until = time.monotonic() + 20.0
            while not file.exists() or file.read_text() == before:
                assert time.monotonic() < until
                time.sleep(0.05)
            process.kill()
        kept.append(int(file.read_text()))
    assert kept[1] > kept[0]
