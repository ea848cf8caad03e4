"""Boats on NMEA lines, as two processes over a pseudo-terminal or sockets."""

from __future__ import annotations

import math
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from alarm_texts import words_of
from two_processes import free_port, patient_vessel

from autopilot.angles import wrap
from autopilot.runtime.record import read_log
from autopilot.signals import Mode, RudderSample
from autopilot.vessel.file import dump_vessel, load_vessel
from autopilot.vessel.schema import Drive
from sitl.scenario import load_scenario

SPEEDUP = 2

STUCK = """
schema_version: 1
name: stuck
faults:
  - {kind: rudder_stuck, from_s: 0, to_s: 100}
"""


@pytest.fixture
def boat(tmp_path: Path, request: pytest.FixtureRequest):
    """A simulated boat with a rudder that sticks from the start, its NMEA line at `line`."""
    scenario = tmp_path / "stuck.yaml"
    scenario.write_text(STUCK)
    load_scenario(str(scenario))
    line = tmp_path / "line"
    command = [sys.executable, "-m", "sitl", "serve", "lanxin", "--speedup", str(SPEEDUP), "--scenario", str(scenario)]
    command += ["--nmea", f"{line}:38400", "--sentences", "HDG:10,ROT:10,RSA:5"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("ready")
        yield line
        process.terminate()


@pytest.mark.parametrize("kind", ["pypilot", "jrk", "maestro"])
def test_a_heading_is_changed_by_a_rudder_drive_on_its_own_line(tmp_path: Path, kind: str) -> None:
    line, drive, log = tmp_path / "line", tmp_path / "drive", tmp_path / "run.tlog"
    boat = patient_vessel(tmp_path)
    filed = Drive(angle_at_full_deg=45.0, amidships=0.05, current_max_a=8.0)
    boat.write_text(dump_vessel(replace(load_vessel(boat), drive=filed)))
    command = [sys.executable, "-m", "sitl", "serve", str(boat), "--speedup", str(SPEEDUP)]
    command += ["--nmea", f"{line}:38400", "--sentences", "HDG:10,ROT:10", "--drive", f"{kind}:{drive}:38400"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("ready nmea")
        assert process.stdout.readline().startswith(f"ready drive {kind}")
        command = [sys.executable, "-m", "autopilot", "run", str(boat), "--link", f"nmea:{line}:38400?steer=no"]
        command += ["--link", f"{kind}:{drive}:38400", "--engage", "30", "--duration", "12", "--log", str(log)]
        command += ["--speedup", str(SPEEDUP)]
        run = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=60, check=False)
        process.terminate()
    assert (run.returncode, run.stderr) == (0, "")
    ticks = read_log(log).ticks
    assert ticks[-1].mode is Mode.ENGAGED, words_of(ticks[-1])
    # of a busy machine's few ticks the last thirty would reach back into the turn
    last = [tick.state.heading for tick in ticks if tick.now > ticks[-1].now - 1.5]
    off = [abs(math.degrees(wrap(heading - math.radians(30.0)))) for heading in last]
    assert max(off) < 3.0
    seen = [sample for tick in ticks for sample in tick.samples if isinstance(sample, RudderSample)]
    assert {sample.ordered for sample in seen} == {kind == "maestro"}
    assert max(abs(sample.angle) for sample in seen) > math.radians(3.0)


@pytest.mark.parametrize(
    ("theirs", "ours", "kind"),
    [("nmea-tcpin", "nmea-tcp", socket.SOCK_STREAM), ("nmea-udpout", "nmea-udp", socket.SOCK_DGRAM)],
)
def test_a_heading_is_changed_over_a_network(tmp_path: Path, theirs: str, ours: str, kind: socket.SocketKind) -> None:
    place = f"127.0.0.1:{free_port(kind)}"
    boat, log = patient_vessel(tmp_path), tmp_path / "run.tlog"
    command = [
        sys.executable,
        "-m",
        "sitl",
        "serve",
        "lanxin",
        "--speedup",
        str(SPEEDUP),
        "--nmea",
        f"{theirs}:{place}",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith(f"ready nmea {theirs}")
        command = [sys.executable, "-m", "autopilot", "run", str(boat), "--link", f"{ours}:{place}"]
        command += ["--engage", "25", "--duration", "8", "--log", str(log), "--speedup", str(SPEEDUP)]
        run = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=60, check=False)
        process.terminate()
    assert (run.returncode, run.stderr) == (0, "")
    ticks = read_log(log).ticks
    assert ticks[-1].mode is Mode.ENGAGED, words_of(ticks[-1])
    assert abs(math.degrees(wrap(ticks[-1].state.heading - math.radians(25.0)))) < 3.0


ROUTE = """
schema_version: 1
name: route
start: {heading_deg: 20}
current: {speed_m_s: 0.5, towards_deg: 90}
route: [[0, 0], [40, 0], [40, 600]]
"""


def test_a_chart_plotter_steers_the_boat_along_its_route_and_hears_us(tmp_path: Path) -> None:
    scenario, log, truth = tmp_path / "route.yaml", tmp_path / "run.tlog", tmp_path / "truth.csv"
    scenario.write_text(ROUTE)
    line = tmp_path / "line"
    command = [sys.executable, "-m", "sitl", "serve", "lanxin", "--speedup", str(SPEEDUP), "--scenario", str(scenario)]
    command += ["--nmea", f"{line}:115200", "--sentences", "HDG:10,ROT:10,RSA:5,VHW:2,APB:2,RMB:1,XTE:2"]
    command += ["--truth", str(truth)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("ready")
        command = [sys.executable, "-m", "autopilot", "run", str(patient_vessel(tmp_path))]
        command += [
            "--link",
            f"nmea:{line}:115200",
            "--follow",
            "plotter",
            "--duration",
            "70",
            "--log",
            str(log),
            "--speedup",
            str(SPEEDUP),
        ]
        run = subprocess.run(
            command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=120, check=False
        )
        process.terminate()
    assert (run.returncode, run.stderr) == (0, "")
    assert read_log(log).ticks[-1].mode is Mode.ENGAGED, words_of(read_log(log).ticks[-1])
    header, *rows = truth.read_text().strip().splitlines()
    north, east = (header.split(",").index(name) for name in ("north_m", "east_m"))
    places = [(float(row.split(",")[north]), float(row.split(",")[east])) for row in rows[:-1]]
    # the boat sails on unsteered until the pilot is there: judged is where it has come to, not when
    at_last = places[-50:]
    assert min(place[1] for place in at_last) > 20.0, "the boat has turned east at the waypoint"
    assert max(abs(place[0] - 40.0) for place in at_last) < 15.0


def test_a_rudder_that_sticks_ends_in_the_fail_safe_with_the_reason(boat: Path, tmp_path: Path) -> None:
    log = tmp_path / "run.tlog"
    command = [sys.executable, "-m", "autopilot", "run", str(patient_vessel(tmp_path)), "--link", f"nmea:{boat}:38400"]
    command += ["--engage", "170", "--duration", "8", "--log", str(log), "--speedup", str(SPEEDUP)]
    run = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=60, check=False)
    assert run.returncode == 5, run.stderr
    assert "steering gear: rudder not responding" in run.stderr
    ticks = read_log(log).ticks
    assert any(tick.mode is Mode.ENGAGED for tick in ticks)
    assert ticks[-1].mode is Mode.FAILSAFE
    assert any("steering gear: rudder not responding" in alarm for alarm in words_of(ticks[-1]))
