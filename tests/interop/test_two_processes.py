"""`sitl serve` and `autopilot run` as the two processes a user starts, over sockets and pseudo-terminals."""

from __future__ import annotations

import math
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from two_processes import free_port, patient_vessel, sailed, sailed_for, simulator

from autopilot.angles import wrap
from autopilot.runtime.record import read_log
from autopilot.signals import Mode
from autopilot.vessel.file import dump_vessel, load_vessel

SPEEDUP = 2
GOAL_DEG = 60.0


@pytest.fixture
def vessel(tmp_path: Path) -> Path:
    return patient_vessel(tmp_path)


def pilot(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "autopilot", "run", *arguments, "--speedup", str(SPEEDUP)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True
    )


def finish(process: subprocess.Popen[str], timeout: float = 60.0) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=timeout)
    assert "Traceback" not in err
    return process.returncode, out, err


def assert_one_sentence(err: str, *parts: str) -> None:
    lines = err.strip().splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith("autopilot: ")
    for part in parts:
        assert part in lines[0]


def assert_reached_and_replays(log: Path) -> None:
    ticks = read_log(log).ticks
    assert ticks[-1].mode is Mode.ENGAGED
    # of a busy machine's few ticks the last forty would reach back into the turn
    late = [abs(wrap(tick.state.heading - math.radians(GOAL_DEG))) for tick in ticks if tick.now > ticks[-1].now - 2.0]
    assert math.degrees(max(late)) < 2.0
    command = [sys.executable, "-m", "autopilot", "replay", str(log)]
    replayed = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert replayed.returncode == 0, replayed.stdout
    assert "every command identical" in replayed.stdout


@pytest.mark.parametrize("steering", ["rc_override", "manual_control"])
def test_a_heading_is_changed_and_held_over_udp(tmp_path: Path, vessel: Path, steering: str) -> None:
    if steering == "manual_control":
        boat = load_vessel(vessel)
        vessel.write_text(dump_vessel(replace(boat, helm=replace(boat.helm, method="manual_control"))))
    port, log, truth = free_port(), tmp_path / "run.tlog", tmp_path / "truth.csv"
    with simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--truth", str(truth)):
        run = pilot(
            str(vessel), "--link", f"udpin:127.0.0.1:{port}", "--as-gcs", "--engage", str(GOAL_DEG),
            "--duration", "18", "--log", str(log),
        )  # fmt: skip
        code, _, err = finish(run)
        assert (code, err) == (0, "")
        last = sailed_for(truth, 1.0)
    assert_reached_and_replays(log)
    assert abs(math.degrees(last["rudder_rad"])) < 1.0, "released: the rudder goes back amidships"


def test_a_heading_is_changed_and_held_over_tcp(tmp_path: Path, vessel: Path) -> None:
    port, log = free_port(socket.SOCK_STREAM), tmp_path / "run.tlog"
    with simulator(SPEEDUP, "--mavlink", f"tcpin:127.0.0.1:{port}"):
        run = pilot(
            str(vessel), "--link", f"tcp:127.0.0.1:{port}", "--as-gcs", "--engage", str(GOAL_DEG),
            "--duration", "18", "--log", str(log),
        )  # fmt: skip
        code, _, err = finish(run)
    assert (code, err) == (0, "")
    assert_reached_and_replays(log)


@pytest.mark.parametrize(("baud", "sentences"), [(4800, "HDG:5,RSA:2"), (38400, "HDG:10,ROT:10,RSA:5,VHW:1")])
def test_a_heading_is_changed_and_held_over_a_serial_line(
    tmp_path: Path, vessel: Path, baud: int, sentences: str
) -> None:
    line, log = tmp_path / "line", tmp_path / "run.tlog"
    with simulator(SPEEDUP, "--nmea", f"{line}:{baud}", "--sentences", sentences):
        run = pilot(
            str(vessel), "--link", f"nmea:{line}:{baud}", "--engage", str(GOAL_DEG), "--duration", "20",
            "--log", str(log),
        )  # fmt: skip
        code, _, err = finish(run)
    assert (code, err) == (0, "")
    assert_reached_and_replays(log)


def test_a_pseudo_terminal_unplugged_in_mid_run_is_one_sentence(tmp_path: Path, vessel: Path) -> None:
    line, log = tmp_path / "line", tmp_path / "run.tlog"
    with simulator(SPEEDUP, "--nmea", f"{line}:38400") as boat:
        run = pilot(
            str(vessel), "--link", f"nmea:{line}:38400", "--engage", "present", "--duration", "60", "--log", str(log)
        )
        assert run.stdout is not None
        while "ENGAGED" not in run.stdout.readline():
            assert run.poll() is None
        time.sleep(0.5)
        boat.kill()
        code, _, err = finish(run)
    assert code == 3
    assert_one_sentence(err, str(line))
    ticks = read_log(log).ticks
    assert any(tick.mode is Mode.ENGAGED for tick in ticks)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_run_cleanly(tmp_path: Path, vessel: Path, number: signal.Signals) -> None:
    port, log, truth = free_port(), tmp_path / "run.tlog", tmp_path / "truth.csv"
    with simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--truth", str(truth)):
        run = pilot(str(vessel), "--link", f"udpin:127.0.0.1:{port}", "--as-gcs", "--engage", "170", "--log", str(log))
        assert run.stdout is not None
        while "ENGAGED" not in run.stdout.readline():
            assert run.poll() is None
        sailed(truth, lambda row: abs(row["rudder_rad"]) > 0.1)
        run.send_signal(number)
        code, _, err = finish(run)
        assert (code, err) == (0, "")
        last = sailed_for(truth, 1.5)
    assert any(abs(tick.command.angle) > 0.1 for tick in read_log(log).ticks)
    assert abs(math.degrees(last["rudder_rad"])) < 1.0


def test_a_killed_pilot_leaves_a_log_and_a_rudder_that_is_let_go(tmp_path: Path, vessel: Path) -> None:
    port, log, truth = free_port(), tmp_path / "run.tlog", tmp_path / "truth.csv"
    with simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--truth", str(truth)):
        run = pilot(str(vessel), "--link", f"udpin:127.0.0.1:{port}", "--as-gcs", "--engage", "170", "--log", str(log))
        assert run.stdout is not None
        while "ENGAGED" not in run.stdout.readline():
            assert run.poll() is None
        sailed(truth, lambda row: abs(row["rudder_rad"]) > 0.1)
        run.kill()
        run.communicate()
        last = sailed_for(truth, 6.0)
    assert read_log(log).ticks[-1].mode is Mode.ENGAGED
    assert abs(math.degrees(last["rudder_rad"])) < 1.0, "the override times out"


def test_the_wrong_system_id_is_refused_with_the_ways_out_and_moves_no_rudder(tmp_path: Path, vessel: Path) -> None:
    port, truth = free_port(), tmp_path / "truth.csv"
    with simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--truth", str(truth)):
        run = pilot(str(vessel), "--link", f"udpin:127.0.0.1:{port}", "--engage", "90", "--duration", "9")
        code, _, err = finish(run)
    assert code == 4
    assert_one_sentence(err, "--as-gcs", "SYSID_MYGCS")
    header, *rows = truth.read_text().strip().splitlines()
    column = header.split(",").index("rudder_rad")
    moved = [abs(float(row.split(",")[column])) for row in rows[:-1]]
    assert len(moved) > 50
    assert math.degrees(max(moved)) < 0.5


def test_the_papers_gains_are_refused_with_the_reason() -> None:
    run = pilot("lanxin_paper_gains", "--link", f"udpin:127.0.0.1:{free_port()}", "--engage", "90")
    code, _, err = finish(run)
    assert code == 4
    assert_one_sentence(err, "refused to engage", "deg/s")


def test_silence_is_a_link_error() -> None:
    run = pilot("lanxin", "--link", f"udpin:127.0.0.1:{free_port()}", "--wait", "2")
    code, _, err = finish(run)
    assert code == 3
    assert_one_sentence(err, "no heading came over udpin:127.0.0.1")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open every port: permission denied cannot be provoked")
def test_a_port_without_permission_names_the_group(tmp_path: Path) -> None:
    port = tmp_path / "ttyUSB0"
    port.touch(mode=0o000)
    code, _, err = finish(pilot("lanxin", "--link", f"nmea:{port}:4800"))
    assert code == 3
    assert_one_sentence(err, "dialout")
