"""The fuzzer of instruments and drives, as its command line, on a sample of its million inputs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_parser_survives_a_sample_of_the_fuzzer_s_inputs() -> None:
    command = [sys.executable, str(ROOT / "benchmarks" / "fuzz_instruments.py"), "--inputs", "3000", "--seed", "7"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    rows = [line.split("|") for line in run.stdout.splitlines()[2:]]
    assert len(rows) == 11
    for row in rows:
        name, accepted, strangers, impossible = row[1].strip(), int(row[3]), int(row[4]), int(row[5])
        assert accepted > 0, f"{name}: nothing was accepted, so nothing was tried"
        assert impossible == 0
        if name in ("NMEA 0183", "pypilot, reports", "NMEA 2000, actisense"):
            assert strangers <= accepted // 100, f"{name}: a checksum lets few wrong values pass"
