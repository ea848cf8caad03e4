"""Boats on NMEA lines, as two processes over a pseudo-terminal or sockets."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from autopilot.loop.record import read_log
from autopilot.signals import Mode
from sitl.scenario import load_scenario

SPEEDUP = 3

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


def test_a_rudder_that_sticks_is_an_override_with_the_reason(boat: Path, tmp_path: Path) -> None:
    log = tmp_path / "run.tlog"
    command = [sys.executable, "-m", "autopilot", "run", "lanxin", "--link", f"nmea:{boat}:38400", "--engage", "170"]
    command += ["--duration", "8", "--log", str(log), "--speedup", str(SPEEDUP)]
    run = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=60, check=False)
    assert run.returncode == 0, run.stderr
    ticks = read_log(log).ticks
    assert any(tick.mode is Mode.ENGAGED for tick in ticks)
    assert ticks[-1].mode is Mode.OVERRIDE
    assert "the rudder does not follow: IIRSA shows" in ticks[-1].alarms[0]
    assert not ticks[-1].command.engaged
