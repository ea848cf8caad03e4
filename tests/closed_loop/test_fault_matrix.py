"""The command of the fault matrix on a sample of its cells, and the page that it has written."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ENGAGED = (
    "nothing|heading lost|heading frozen|rudder stuck, with a rudder sensor|"
    "somebody chooses HOLD|heading jumps by 40 deg|link half open|the law returns no number"
)


@pytest.mark.parametrize(
    ("rows", "states", "seeds", "cells"),
    [
        (ENGAGED, "heading", 1, 8),
        ("heading lost|somebody disarms", "trial", 1, 2),
        ("link silent|firmware reboots", "fail-safe", 1, 2),
        ("rate reversed", "heading,turn", 4, 2),
    ],
)
def test_a_sample_of_cells_is_as_expected(rows: str, states: str, seeds: int, cells: int) -> None:
    command = [
        sys.executable,
        str(ROOT / "benchmarks" / "fault_matrix.py"),
        "--rows",
        f"^({rows})$",
        "--states",
        states,
        "--seeds",
        str(seeds),
    ]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    assert f"{cells} cells with {seeds} seeds, 0 not as expected\n" in run.stdout


def test_the_page_holds_the_whole_matrix() -> None:
    page = (ROOT / "docs" / "fault_matrix.md").read_text(encoding="utf-8")
    found = re.search(r"^(\d+) rows in (\d+) states, (\d+) cells with 5 seeds", page, re.MULTILINE)
    assert found is not None
    rows, states, cells = map(int, found.groups())
    assert rows >= 45
    assert rows * states - rows <= cells <= rows * states
    first, second = page.split("## In the other states")
    names = set(re.findall(r"^\| (?!Fault )([^|]+) \|", second, re.MULTILINE))
    assert len(names) == rows
    assert all(f"| {name}" in first for name in names)
    # a cell more, or another one, is a limit that somebody has broken; these are told of on the page
    marked = [line.split("|")[1].removesuffix(" **!** ").strip() for line in page.splitlines() if "**!** |" in line]
    assert marked == ["pushed by a gust worth 15 deg of rudder"]
    assert page.count("**!** |") == len(marked)
    assert "cells with 5 seeds: 1 not as expected, marked" in page
