"""A boat of which four numbers are known comes from an empty folder to its first hold, without a question."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from two_processes import free_port, simulator

from autopilot.vessel.file import load_vessel

NUMBERS = ("--length-m", "7", "--speed-kn", "9", "--rudder-max-deg", "30", "--side-to-side-s", "3")


def test_four_numbers_lead_to_the_first_hold(tmp_path: Path) -> None:
    port = free_port()
    with simulator(2.0, "--mavlink", f"udpout:127.0.0.1:{port}"):
        command = [sys.executable, "-m", "autopilot", "new-boat", "mine.yaml", "--yes", "--speedup", "2", *NUMBERS]
        link = ["--link", f"udpin:127.0.0.1:{port}", "--as-gcs"]
        done = subprocess.run([*command, *link], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=400)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr
    boat, truth = load_vessel(tmp_path / "mine.yaml"), load_vessel("lanxin")
    assert abs(boat.model.K_1_s / truth.model.K_1_s - 1.0) < 0.1
    assert boat.control.backstepping is not None and boat.alarms.reversed_rudder
    assert "Done: mine.yaml steers" in done.stdout
