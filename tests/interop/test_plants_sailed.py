"""The commands of a sea trial on each plant of the simulator, as two processes: trial, identify, run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from two_processes import free_port, simulator

DRIFTS = pytest.mark.xfail(
    reason="over MAVLink alone, without a log, it drifts on against a zigzag's rudder: the trial is doubted and ends"
)
LASTS = [
    ("mmg_tanker", 12.0, 200.0),
    ("roll_ship", 8.0, 80.0),
    pytest.param("small_craft", 5.0, 60.0, marks=DRIFTS),
    ("twin_thruster", 5.0, 50.0),
    ("outboard", 5.0, 50.0),
]


def autopilot(*words: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "autopilot", *words],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120.0,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize(("kind", "speedup", "seconds"), LASTS)
def test_trial_identify_and_run_on_each_plant(kind: str, speedup: float, seconds: float, tmp_path: Path) -> None:
    port, log = free_port(), tmp_path / "trial.tlog"
    link = ["--link", f"udpin:127.0.0.1:{port}", "--as-gcs", "--speedup", str(speedup)]
    zigzag = ["--rudder-deg", "10", "--heading-deg", "10", "--duration", str(seconds), "--log", str(log)]
    with simulator(speedup, "--mavlink", f"udpout:127.0.0.1:{port}", kind=kind):
        autopilot("trial", "zigzag", kind, *link, *zigzag)
        said = autopilot("run", kind, *link, "--engage", "20", "--duration", "40")
    assert "last course 020" in said and "fail-safe" not in said
    found = json.loads(autopilot("identify", str(log), "--vessel", kind, "--json"))
    assert found["runs"][0]["yaw_rate_r2"] > 0.8
