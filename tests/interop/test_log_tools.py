"""The log of a run over a signed link, as pymavlink's own log tools read it: all is there but the signatures."""

from __future__ import annotations

import hashlib
import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path

from two_processes import free_port, patient_vessel, simulator

from autopilot.runtime.record import read_log, read_packets, replay
from autopilot.signals import Mode

SPEEDUP = 2
PASSPHRASE = "correct horse battery staple"


def tool(name: str, *arguments: str) -> str:
    """Run one of pymavlink's own log tools and return what it prints."""
    path = Path(sys.executable).parent / name
    command = [sys.executable, "-W", "ignore", str(path), *arguments]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=60, check=False, env={**os.environ, "MAVLINK20": "1"}
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_pymavlink_reads_the_log_of_a_signed_run_without_signatures(tmp_path: Path) -> None:
    port, log, key = free_port(), tmp_path / "run.tlog", tmp_path / "signing.key"
    key.write_text(PASSPHRASE)
    key.chmod(0o600)
    with simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--signing-key", str(key)):
        pilot = [sys.executable, "-m", "autopilot", "run", str(patient_vessel(tmp_path)), "--as-gcs", "--log", str(log)]
        pilot += ["--signing-key", str(key)]
        pilot += ["--link", f"udpin:127.0.0.1:{port}", "--engage", "20", "--duration", "16", "--speedup", str(SPEEDUP)]
        subprocess.run(pilot, check=True, timeout=60, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    ticks = read_log(log).ticks
    assert ticks[-1].mode is Mode.ENGAGED and abs(math.degrees(ticks[-1].state.heading) - 20.0) < 2.0
    assert replay(log).identical
    content = log.read_bytes()
    assert hashlib.sha256(PASSPHRASE.encode()).digest() not in content and PASSPHRASE.encode() not in content
    assert not any(packet[0] == 0xFD and packet[2] & 1 for _, packet in read_packets(log))
    yaws, times, named = [], [], {}
    dumped = tool("mavlogdump.py", "--format", "json", "--types", "ATTITUDE,NAMED_VALUE_FLOAT", str(log))
    for line in map(json.loads, dumped.splitlines()):
        data = line["data"]
        if line["meta"]["type"] == "ATTITUDE":
            yaws.append(data["yaw"])
            times.append(line["meta"]["timestamp"])
        else:
            named.setdefault(data["name"], []).append(data["value"])
    assert len(yaws) > 100 and abs(yaws[-1] - ticks[-1].state.heading) < 0.05
    assert times == sorted(times) and abs(times[-1] - time.time()) < 120.0
    assert set(named) >= {"psi_deg", "psi_d_deg", "rudcmd_deg", "rud_deg", "bias_deg", "mode"}
    assert abs(named["psi_deg"][-1] - math.degrees(ticks[-1].state.heading)) < 1.0
    assert named["mode"][-1] == float(Mode.ENGAGED)
    parameters = dict(line.split()[:2] for line in tool("mavparms.py", str(log)).splitlines() if line.strip())
    assert float(parameters["SYSID_MYGCS"]) == 255.0 and "RC_OVERRIDE_TIME" in parameters
