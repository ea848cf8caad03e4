"""The fuzzer of everything that reads MAVLink, as its command line, on a sample of its million inputs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
READERS = 9


def test_every_reader_survives_a_sample_of_the_fuzzer_s_inputs() -> None:
    command = [sys.executable, str(ROOT / "benchmarks" / "fuzz_mavlink.py"), "--inputs", "1500", "--seed", "7"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    rows = [[cell.strip() for cell in line.split("|")] for line in run.stdout.splitlines()[2:]]
    assert len(rows) == READERS
    for _, name, inputs, accepted, strangers, wrong, held, *_ in rows:
        assert int(accepted) > 0, f"{name}: nothing was accepted, so nothing was tried"
        assert int(wrong) == 0, name
        assert int(held) < 4096, name
        if name != "servo packets (sitl)":  # which have no checksum
            assert int(strangers) <= int(inputs) // 1000, name
