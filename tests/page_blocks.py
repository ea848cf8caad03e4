"""The shell blocks of README and docs, each with what the page says about running it.

A comment in the page's source, just before a block, says so:

    <!-- run: files -->       run in one process, in a folder of the page's own, by every run of the tests
    <!-- run: page -->        run as processes, by every run of the tests
    <!-- run: slow -->        the same with NORRBIN_SLOW=1, each block alone
    <!-- run: first -->       run before each of the page's slow blocks: what starts the boat that they need
    <!-- run: added -->       run in a copy of the house with what the page adds, by test_pages_that_add.py
    <!-- command: NAME -->    run by the gate under this name
    <!-- not run: REASON -->  what it would need

What is printed is what is run. A line whose comment says `exit code 6`, or `exit code 0 or 4`, ends with that one.

Blocks that call only `python benchmarks/...` make the tables of the page and need no mark, nor do those of pytest.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if "reference" not in page.relative_to(ROOT).parts),
]
PROGRAMS = ("autopilot", "sitl")
SHELLS = ("sh", "bash", "console")
CALLS = (*PROGRAMS, "python", "python3", "pip", "sudo", "cd", "dask", "npm", "git")
"""First words by which a block without a language is taken for one of commands."""
MEASURES = ("python benchmarks/", "python -m pytest ")
INSTALLS = re.compile(r"^(?:\S*python -m )?pip install ")
FENCE = re.compile(r"^( *)```(\S*)\s*$")
MARK = re.compile(r"^\s*<!-- (run|not run|command): (.+?) -->\s*$")
PROGRAM_PATH = re.compile(r"^(?:\S*/)?(?=(?:autopilot|sitl) )")


class Block(NamedTuple):
    """A block of commands: its page and line, the mark before it, what that says, its lines, continued ones joined."""

    page: Path
    line: int
    mark: str
    said: str
    lines: tuple[str, ...]

    @property
    def is_measurement(self) -> bool:
        """Whether it only makes tables and figures again, or runs tests."""
        return all(line.startswith(MEASURES) for line in self.lines if not INSTALLS.match(line))

    @property
    def calls(self) -> list[str]:
        """The lines that call one of our programs, without the folder it stands in."""
        calls = [PROGRAM_PATH.sub("", line) for line in self.lines]
        return [line for line in calls if line.split(" ")[0] in PROGRAMS]


def blocks_of(page: Path) -> list[Block]:
    """Return the page's blocks of commands."""
    found = []
    for start, language, mark, text in _code(page.read_text(encoding="utf-8").splitlines()):
        joined = re.sub(r"\\\n\s*", " ", "\n".join(text))
        lines = tuple(line.strip().removeprefix("$ ") for line in joined.splitlines() if line.strip())
        words = {PROGRAM_PATH.sub("", line).split(" ")[0] for line in lines}
        if language in SHELLS or (not language and words & set(CALLS)):
            found.append(Block(page, start, *mark, lines))
    return found


def _code(lines: list[str]) -> Iterator[tuple[int, str, tuple[str, str], list[str]]]:
    """Yield the line, language, mark and text of each code block, fenced or indented by four."""
    mark, at = ("", ""), 0
    while at < len(lines):
        line = lines[at]
        fence, marked = FENCE.match(line), MARK.match(line)
        start = at + 1
        if fence is not None:
            end = next(i for i in range(start, len(lines)) if lines[i].strip() == "```")
            yield start, fence[2], mark, lines[start:end]
            mark, at = ("", ""), end
        elif line.startswith("    ") and (at == 0 or not lines[at - 1].strip() or MARK.match(lines[at - 1])):
            while at + 1 < len(lines) and lines[at + 1].startswith("    "):
                at += 1
            yield start, "", mark, lines[start - 1 : at + 1]
            mark = ("", "")
        elif marked is not None:
            mark = (marked[1], marked[2])
        elif line.strip() and marked is None:
            mark = ("", "")
        at += 1
