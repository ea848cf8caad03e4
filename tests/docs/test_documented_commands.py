"""Every command line in README and docs is one that the programs take; pages that say so are run from top to bottom.

A block after `<!-- run: page -->` is run, five times as fast as it is printed where it sails, on a port of its own;
what such a page needs beside it stands in a comment, `<!-- run: before COMMAND -->`.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from two_processes import free_port

from autopilot.cli.main import build_parser as autopilot_parser
from sitl.cli import build_parser as sitl_parser

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
PARSERS = {"autopilot": autopilot_parser, "sitl": sitl_parser}
FENCED = re.compile(r"^```(?:sh|bash|console)?\n(.*?)^```", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"(?:^(?: {4,}|\t).*\n)+", re.MULTILINE)
RUN = re.compile(r"<!-- run: page -->\n```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
BEFORE = re.compile(r"<!-- run: before (.*?) -->")
SAILS = re.compile(r"^((?:sitl serve|autopilot run|autopilot trial [a-z-]+)) ", re.MULTILINE)


def command_lines(page: Path) -> list[str]:
    """Return the lines of the page's code blocks that call one of our programs, continued lines joined."""
    text = page.read_text(encoding="utf-8")
    blocks = [*FENCED.findall(text), *INDENTED.findall(FENCED.sub("", text))]
    lines = [line.strip() for block in blocks for line in re.sub(r"\\\n\s*", " ", block).splitlines()]
    calls = [re.sub(r"^(?:\S*/)?(?=(?:autopilot|sitl) )", "", line.removeprefix("$ ")) for line in lines]
    return [line for line in calls if line.split(" ")[0] in PARSERS]


def arguments(line: str) -> list[str]:
    """Return the words up to a comment, a pipe, a redirection, a list or a background mark."""
    words = shlex.split(line, comments=True)
    ends = [index for index, word in enumerate(words) if word in {"|", "||", "&", "&&", ";", ">", ">>", "2>", "<"}]
    return words[1 : ends[0]] if ends else words[1:]


CASES = [pytest.param(line, id=f"{page.name}: {line}"[:100]) for page in PAGES for line in command_lines(page)]


def test_there_are_commands_to_look_at() -> None:
    assert len(CASES) > 40


@pytest.mark.parametrize("line", CASES)
def test_a_documented_command_is_taken_by_the_program(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = arguments(line)
    try:
        PARSERS[line.split(" ")[0]]().parse_args(words)
    except SystemExit as ended:
        assert ended.code == 0, capsys.readouterr().err


PAGES_RUN = [page for page in PAGES if RUN.search(page.read_text(encoding="utf-8"))]


@pytest.mark.real_time
@pytest.mark.parametrize("page", PAGES_RUN, ids=lambda page: page.stem)
def test_a_page_that_says_so_runs_from_top_to_bottom(page: Path, tmp_path: Path) -> None:
    folder = tmp_path / "bin"
    folder.mkdir()
    for name, module in (("autopilot", "autopilot"), ("sitl", "sitl")):
        script = folder / name
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m {module} "$@"\n')
        script.chmod(0o755)
    text = page.read_text(encoding="utf-8")
    blocks = SAILS.sub(r"\1 --speedup 5 ", "\n".join([*BEFORE.findall(text), *RUN.findall(text)]))
    blocks = blocks.replace("14550", str(free_port()))
    script = f"set -e\ntrap 'kill $(jobs -p) 2> {os.devnull} || true' EXIT\n{blocks}"
    environment = {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=400,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
