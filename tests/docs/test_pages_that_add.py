"""The pages `docs/howto/add_a_*.md`: what they add is added to a copy of the house, and their commands are run there.

A block whose first line is `# PATH` is that file; a `diff` is a change of one: its added lines follow the line above
them. One file and one line it must be, and nothing else.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from documented_files import furnish
from page_blocks import ROOT, blocks_of

PAGES = sorted((ROOT / "docs" / "howto").glob("add_a_*.md"))
BLOCK = re.compile(r"^```(python|diff)\n# (\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PROOFS = {
    "add_a_plant": """
import math
from autopilot.vessel.file import load_vessel
from sitl.scenario import load_scenario
from sitl.world import Orders, World

class Helm:
    def orders(self, time):
        return Orders(math.radians(10.0))

with open("skiff.yaml", "w") as file:
    file.write("schema_version: 1\\nname: skiff\\nplant: skiff\\n")
vessel = load_vessel("lanxin")
world = World(vessel, load_scenario("skiff.yaml"))
world.helms.append(Helm())
world.advance(20.0)
drive, state = vessel.model.K_1_s / vessel.model.T_s, world.boat.state
assert type(world.boat.plant).__name__ == "Skiff" and state.rudder > 0.17
# drive rudder = rate + 9 rate^2 in a steady turn
assert abs(state.rate + 9.0 * state.rate**2 - drive * state.rudder) < 1e-6
""",
    "add_a_fault": """
import math
from autopilot.vessel.file import load_vessel
from sitl.scenario import FaultSection, Scenario
from sitl.world import Orders, World

class Helm:
    rudder = math.radians(2.0)
    def orders(self, time):
        return Orders(self.rudder)

world = World(load_vessel("lanxin"), Scenario(1, "stiff", faults=(FaultSection("rudder_stiff", 0.0),)))
world.helms.append(Helm())
world.advance(3.0)
assert world.boat.state.rudder == 0.0
Helm.rudder = math.radians(10.0)
world.advance(6.0)
assert abs(math.degrees(world.boat.state.rudder) - 7.0) < 1.0, world.boat.state.rudder
""",
    "add_a_log_format": """
from autopilot.errors import InputError
from autopilot.logs.reading import examples, load_run, read_recording

run = load_run("run.boatlog")
assert len(run.segments) == 1 and run.segments[0].speed[0] == 4.0
assert "a boat log" in examples()
with open("bad.boatlog", "w") as file:
    file.write("BOATLOG 1\\n0 0 0\\n")
try:
    read_recording("bad.boatlog")
except InputError as error:
    assert "bad.boatlog: a line is not four numbers" in str(error), error
else:
    raise AssertionError
""",
    "add_a_drive": """
import math, os, pty
from autopilot.links.url import EXAMPLES
from autopilot.runtime.build_links import LinkOptions, build_link
from autopilot.signals import RudderCommand
from autopilot.vessel.file import load_vessel

vessel, (far, near) = load_vessel("lanxin"), pty.openpty()
assert EXAMPLES["text"] == "text:/dev/ttyUSB2:9600"
link = build_link(vessel, f"text:{os.ttyname(near)}:9600", LinkOptions())
link.send(0.0, RudderCommand(0.0, 0.5 * math.radians(vessel.rudder.angle_max_deg), True))
assert os.read(far, 64) == b"50.0\\n"
link.release(1.0)
assert os.read(far, 64).startswith(b"off\\n")
""",
    "add_a_law": """
from autopilot.report.gains import survives
from autopilot.runtime.build import build_pilot
from autopilot.vessel.file import load_vessel
from autopilot.vessel.parameters import parameters_of

vessel = load_vessel("boat.yaml")
assert build_pilot(vessel).law.name == "proportional"
assert {"PRO_KP", "PRO_KD"} <= {each.name for each in parameters_of(vessel)}
assert survives(vessel)
""",
}
"""What the house can do with what a page adds, beside the page's own commands."""


class Added(NamedTuple):
    """A page's block: the file, whether it is a change of one that is there, and its text."""

    path: str
    is_change: bool
    text: str


def added_by(page: Path) -> list[Added]:
    """Return what a page adds."""
    return [Added(path, kind == "diff", text) for kind, path, text in BLOCK.findall(page.read_text(encoding="utf-8"))]


def changed(text: str, change: str) -> str:
    """Return the text with the added lines of a `diff` below the lines that stand above them."""
    lines = text.splitlines()
    at = -1
    for line in change.splitlines():
        if line.startswith("+"):
            at += 1
            lines.insert(at, line[1:])
        else:
            at = lines.index(line[1:])
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_page_adds_is_one_file_and_one_line(page: Path) -> None:
    files = [each for each in added_by(page) if not each.is_change]
    lines = [line for each in added_by(page) if each.is_change for line in each.text.splitlines()]
    assert len(files) == 1 and not (ROOT / files[0].path).exists()
    assert len([line for line in lines if line.startswith("+")]) == 1


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_page_adds_works(page: Path, tmp_path: Path) -> None:
    for room in ("autopilot", "sitl", "firmware_params"):
        shutil.copytree(ROOT / room, tmp_path / room, ignore=shutil.ignore_patterns("__pycache__"))
    for path, is_change, text in added_by(page):
        file = tmp_path / path
        file.write_text(changed(file.read_text(encoding="utf-8"), text) if is_change else text, encoding="utf-8")
    commands = [line for block in blocks_of(page) if block.said == "added" for line in block.lines]
    furnish(tmp_path, commands)
    programs = (f'{name}() {{ "{sys.executable}" -m {name} "$@"; }}' for name in ("autopilot", "sitl"))
    script = "\n".join(["set -e", *programs, *commands, f'"{sys.executable}" - <<"PROOF"', PROOFS[page.stem], "PROOF"])
    surroundings = {**os.environ, "PYTHONPATH": str(tmp_path), "NORRBIN_STATE": str(tmp_path / "state")}
    done = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env=surroundings, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
