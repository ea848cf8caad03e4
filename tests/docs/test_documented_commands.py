"""Every command line in README and docs is one that the programs take, and is run or says why not: see `page_blocks`.

`NORRBIN_SLOW=1 python -m pytest tests/docs` runs the slow ones, too.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from documented_files import furnish
from page_blocks import INSTALLS, PAGES, ROOT, Block, blocks_of

from autopilot.cli.main import build_parser as autopilot_parser
from autopilot.cli.main import main as autopilot
from sitl.cli import build_parser as sitl_parser
from sitl.cli import main as sitl

PARSERS = {"autopilot": cache(autopilot_parser), "sitl": cache(sitl_parser)}
MAINS = {"autopilot": autopilot, "sitl": sitl}
SLOW = os.environ.get("NORRBIN_SLOW") == "1"
STAYS = re.compile(
    r"^((?:autopilot (?:web|signalk)|sitl ardupilot-physics|sitl serve(?!.*--duration)) [^&\n]*)$", re.MULTILINE
)
"""What goes on until it is stopped is stopped as Ctrl-C does, three seconds after it has said its first word."""
CODES = re.compile(r"^(.*\S) +# exit code (\d)(?: or (\d))?\b.*$", re.MULTILINE)
STAY = """stay() {
    env --default-signal=INT "$@" > stay.txt &
    local pid=$!
    while [ ! -s stay.txt ] && kill -0 $pid; do sleep 0.2; done
    sleep 3
    kill -INT $pid
    wait $pid
}"""
SETS_PATH = re.compile(r"^export PATH=")
"""In these tests the programs are on the path already."""
SAID_BY_THE_GATE = ("demo", "tests", "workflow")
BLOCKS = [block for page in PAGES for block in blocks_of(page)]
CASES = [pytest.param(line, id=f"{block.page.name}: {line}"[:100]) for block in BLOCKS for line in block.calls]


def arguments(line: str) -> list[str]:
    """Return the words up to a comment, a pipe, a redirection, a list or a background mark."""
    words = shlex.split(line, comments=True)
    ends = [index for index, word in enumerate(words) if word in {"|", "||", "&", "&&", ";", ">", ">>", "2>", "<"}]
    return words[1 : ends[0]] if ends else words[1:]


def marked(kind: str) -> list[Path]:
    """Return the pages with blocks to be run in this way."""
    return [page for page in PAGES if any((block.mark, block.said) == ("run", kind) for block in blocks_of(page))]


def lines_of(page: Path, kind: str) -> list[str]:
    """Return the lines of the page's blocks to be run in this way; what they install is there."""
    blocks = [block for block in blocks_of(page) if (block.mark, block.said) == ("run", kind)]
    return [line for block in blocks for line in block.lines if not (INSTALLS.match(line) or SETS_PATH.match(line))]


def test_there_are_commands_to_look_at() -> None:
    assert len(CASES) > 80 and len(BLOCKS) > 80
    assert len([block for block in BLOCKS if block.mark == "run"]) > 20


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: f"{block.page.name}:{block.line}")
def test_a_block_of_commands_is_run_or_says_why_not(block: Block) -> None:
    where = f"{block.page.name}, line {block.line}"
    if block.mark == "run":
        assert block.said in ("files", "page", "slow", "first", "added"), where
    elif block.mark == "command":
        assert block.said in SAID_BY_THE_GATE and f"readme_command.py {block.said})" in (ROOT / ".ci/run").read_text()
    elif block.mark == "not run":
        assert len(block.said.split()) > 2, f"{where}: say what it would need"
    else:
        assert block.is_measurement, f"{where}: mark it (tests/page_blocks.py)"
        for line in (line for line in block.lines if not INSTALLS.match(line)):
            words = shlex.split(line, comments=True)[1:]
            files = [word for word in words if word.startswith(("benchmarks/", "tests/"))]
            assert files and all((ROOT / file).exists() for file in files), f"{where}: {line}"
            if words[0] == files[0]:
                text = (ROOT / files[0]).read_text(encoding="utf-8")
                unknown = [word for word in words if word.startswith("--") and f'"{word}"' not in text]
                assert unknown == [], f"{where}: {line}"


PLACE = re.compile(r"\b(?:udpin|tcp|serial|nmea|nmea-tcp|nmea-udp|pypilot|jrk|maestro):(?!//)([^\s'?]+)")
"""Of a link at whose other end somebody must be."""


@pytest.mark.parametrize(
    "block",
    [block for block in BLOCKS if block.mark == "run" and block.said in ("page", "slow")],
    ids=lambda block: f"{block.page.name}:{block.line}",
)
def test_what_a_block_connects_to_is_started_on_the_page(block: Block) -> None:
    earlier = [each for each in blocks_of(block.page) if each.line < block.line and each.said in ("first", block.said)]
    shown = [line for each in earlier if each.said in ("first", "page") for line in each.lines]
    for line in block.lines:
        for place in PLACE.findall(line.partition(" #")[0]) if line.startswith("autopilot ") else ():
            started = [one for one in shown if one.rstrip().endswith("&") and place in one]
            assert started, f"{block.page.name}, line {block.line}: nothing on the page starts {place}"
        shown.append(line)


@pytest.mark.parametrize("line", CASES)
def test_a_documented_command_is_taken_by_the_program(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = arguments(line)
    try:
        PARSERS[line.split(" ")[0]]().parse_args(words)
    except SystemExit as ended:
        assert ended.code == 0, capsys.readouterr().err


@pytest.mark.parametrize("page", marked("files"), ids=lambda page: page.stem)
def test_a_page_that_works_on_files_runs_from_top_to_bottom(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = lines_of(page, "files")
    furnish(tmp_path, lines)
    (tmp_path / "firmware_params").symlink_to(ROOT / "firmware_params")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NORRBIN_STATE", str(tmp_path / "state"))
    for line in lines:
        program = line.split(" ")[0]
        assert MAINS[program](arguments(line)) == 0, f"{line}\n{capsys.readouterr().err}"


@pytest.mark.real_time
@pytest.mark.parametrize("page", marked("page"), ids=lambda page: page.stem)
def test_a_page_that_says_so_runs_from_top_to_bottom(page: Path, tmp_path: Path) -> None:
    run_as_processes(lines_of(page, "page"), tmp_path)


@pytest.mark.real_time
@pytest.mark.skipif(not SLOW, reason="set NORRBIN_SLOW=1")
@pytest.mark.parametrize(
    "block",
    [block for block in BLOCKS if (block.mark, block.said) == ("run", "slow")],
    ids=lambda block: f"{block.page.stem}:{block.line}",
)
def test_a_block_that_takes_longer_runs(block: Block, tmp_path: Path) -> None:
    lines = [line for line in block.lines if not INSTALLS.match(line)]
    run_as_processes([*lines_of(block.page, "first"), *lines], tmp_path)


@contextlib.contextmanager
def ports_to_itself() -> Iterator[list[str]]:
    """Yield the words before a command that has a loopback network of its own; where that cannot be, no other page runs
    meanwhile.
    """
    user = [] if os.geteuid() == 0 else ["--map-root-user"]
    alone = ["unshare", *user, "--net", "sh", "-c", 'ip link set lo up && exec "$@"', "sh"]
    try:
        can_be = subprocess.run([*alone, "true"], capture_output=True, check=False).returncode == 0
    except OSError:
        can_be = False
    if can_be:
        yield alone
        return
    with (Path(tempfile.gettempdir()) / f"norrbin-pages-{os.getuid()}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield []


def run_as_processes(lines: list[str], folder: Path) -> None:
    """Run the lines as one script, in a folder where temporary files are their own."""
    furnish(folder, lines)
    for name in ("bin", "tmp"):
        (folder / name).mkdir()
    for name in ("autopilot", "sitl"):
        script = folder / "bin" / name
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m {name} "$@"\n')
        script.chmod(0o755)
    text = STAYS.sub(r"stay \1", "\n".join(lines))
    text = CODES.sub(r'code=0; \1 || code=$?; [[ "\2\3" = *$code* ]]', text)
    text = text.replace("/tmp/", f"{folder}/tmp/")
    environment = {
        **os.environ,
        "PATH": f"{folder / 'bin'}:{Path(sys.executable).parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "NORRBIN_STATE": str(folder / "state"),
    }
    whole = f"set -e\ntrap 'kill $(jobs -p) 2> {os.devnull} || true' EXIT\n{STAY}\n{text}"
    with ports_to_itself() as alone:
        script = subprocess.Popen(
            [*alone, "bash", "-c", whole],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            said, complained = script.communicate(timeout=400)
        finally:
            # whatever it has started ends with it
            with contextlib.suppress(ProcessLookupError):
                os.killpg(script.pid, signal.SIGKILL)
    assert script.returncode == 0, f"{text}\n{said[-2000:]}\n{complained[-2000:]}"
