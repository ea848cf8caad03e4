"""`.ci/slow`: every study that it names can be run, and a name that it does not know is refused before anything is."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SLOW = ROOT / ".ci" / "slow"


def test_every_study_named_has_commands_that_exist() -> None:
    text = SLOW.read_text(encoding="utf-8")
    (names,) = re.findall(r"^names=\((.*)\)$", text, re.MULTILINE)
    assert names.split() == re.findall(r"^        (\w+)\)", text, re.MULTILINE)
    files = re.findall(r"(?:benchmarks|tests)/[\w/]+\.py", text)
    assert len(files) > 10
    assert [file for file in files if not (ROOT / file).exists()] == []


def test_what_is_left_to_the_night_is_there() -> None:
    """Each line is a test; a name that nobody has any more would run nowhere."""
    lines = (ROOT / "tests" / "nightly.txt").read_text(encoding="utf-8").splitlines()
    assert lines == sorted(set(lines))
    functions = {line.partition("[")[0] for line in lines}
    missing = [
        each
        for each in functions
        for file, _, name in [each.partition("::")]
        if f"def {name}(" not in (ROOT / file).read_text(encoding="utf-8")
    ]
    assert missing == []


def test_what_is_left_to_the_night_has_parameters_that_there_are(stale_nightly: list[str]) -> None:
    assert stale_nightly == []


def test_what_is_the_core_is_there() -> None:
    lines = (ROOT / "tests" / "core.txt").read_text(encoding="utf-8").splitlines()
    assert lines == sorted(set(lines))
    assert [line for line in lines if not (ROOT / line).exists()] == []


def test_a_study_that_there_is_not_is_refused() -> None:
    done = subprocess.run(["bash", str(SLOW), "mutations"], capture_output=True, text=True, timeout=20, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("slow: there is no mutations; allowed are mutation races pilot ")


def test_mutants_of_a_room_that_there_is_not_are_refused() -> None:
    """The night's first study reads what it is asked for."""
    command = [sys.executable, ROOT / "benchmarks" / "mutation.py", "--rooms", "limits,attic"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.endswith(
        ": error: there is no room limits; allowed are supervision, links, estimation, control\n"
    )


@pytest.mark.parametrize("link", [(), ("--mavlink",)], ids=["direct", "MAVLink"])
def test_a_day_can_be_sailed(link: tuple[str, ...]) -> None:
    """The first 36 s of one, over either link: nothing is missed."""
    command = [sys.executable, ROOT / "benchmarks" / "endurance.py", "simulated", "--hours", "0.01", *link]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
