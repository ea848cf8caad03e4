"""The fuzzer of the whole pilot and of every reader of files, as its command line, on a sample of its inputs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
TARGETS = 24


def test_pilot_and_readers_survive_a_sample_of_the_fuzzer_s_inputs(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "benchmarks" / "fuzz_everything.py"), "--inputs", "60", "--seed", "7"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run(
        command, capture_output=True, text=True, env=environment, timeout=300, check=False, cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    rows = [[cell.strip() for cell in line.split("|")] for line in run.stdout.splitlines()[2:]]
    assert len(rows) == TARGETS
    taken = sum(int(row[3]) for row in rows)
    assert taken > 100, "damage that leaves nothing readable tries nothing but the refusals"
    assert all(int(row[2]) >= 60 for row in rows)
