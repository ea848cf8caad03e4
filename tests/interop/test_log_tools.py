"""The log as pymavlink's own log tools read it."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path

from two_processes import free_port, patient_vessel, simulator

from autopilot.loop.record import read_log
from autopilot.signals import Mode

SPEEDUP = 4


def tool(name: str, *arguments: str) -> str:
    """Run one of pymavlink's own log tools and return what it prints."""
    path = Path(sys.executable).parent / name
    command = [sys.executable, "-W", "ignore", str(path), *arguments]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=60, check=False, env={**os.environ, "MAVLINK20": "1"}
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_pymavlinks_log_tools_read_our_log(tmp_path: Path) -> None:
    port, log = free_port(), tmp_path / "run.tlog"
    with simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}"):
        pilot = [sys.executable, "-m", "autopilot", "run", str(patient_vessel(tmp_path)), "--as-gcs", "--log", str(log)]
        pilot += ["--link", f"udpin:127.0.0.1:{port}", "--engage", "20", "--duration", "16", "--speedup", str(SPEEDUP)]
        subprocess.run(pilot, check=True, timeout=60, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    ticks = read_log(log).ticks
    rows = list(csv.DictReader(io.StringIO(tool("mavlogdump.py", "--format", "csv", "--types", "ATTITUDE", str(log)))))
    yaws = [float(row["ATTITUDE.yaw"]) for row in rows]
    assert len(yaws) > 100 and abs(yaws[-1] - ticks[-1].state.heading) < 0.05
    times = [float(row["timestamp"]) for row in rows]
    assert times == sorted(times) and abs(times[-1] - time.time()) < 120.0
    named: dict[str, list[float]] = {}
    for text in tool("mavlogdump.py", "--format", "json", "--types", "NAMED_VALUE_FLOAT", str(log)).splitlines():
        data = json.loads(text)["data"]
        named.setdefault(data["name"], []).append(data["value"])
    assert set(named) >= {"psi_deg", "psi_d_deg", "rudcmd_deg", "rud_deg", "bias_deg", "mode"}
    assert abs(named["psi_deg"][-1] - math.degrees(ticks[-1].state.heading)) < 1.0
    assert named["mode"][-1] == float(Mode.ENGAGED)
    parameters = dict(line.split()[:2] for line in tool("mavparms.py", str(log)).splitlines() if line.strip())
    assert float(parameters["SYSID_MYGCS"]) == 255.0 and "RC_OVERRIDE_TIME" in parameters
