"""Nothing is decided by how an alarm or a reason is worded: looked for in the source itself."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LOOKS = ("startswith", "endswith", "removeprefix", "removesuffix", "partition", "rpartition", "split", "find", "index")
LOOKS += ("count", "replace", "match", "search", "fullmatch", "findall")
SENTENCES = (
    "alarm",
    "alarms",
    "cause",
    "detail",
    "reason",
    "refusal",
    "remedy",
    "said",
    "sentence",
    "trouble",
    "warning",
)
"""Names of what holds a sentence about an alarm, a lost helm or a refusal."""
MAKERS = ("sentence_of", "sentences_of")
EDGES = {
    "supervision/panel.py": "makes the sentences",
    "links/mavlink/authority.py": "reads the vehicle's STATUSTEXT",
    "links/mavlink/conditions.py": "reads the vehicle's STATUSTEXT",
    "links/mavlink/vehicle.py": "reads the vehicle's STATUSTEXT",
    "links/transports/serial_line.py": "reads the system's errors",
    "doctor/machine.py": "reads what other programs print",
    "cli/options.py": "reads what argparse says of a mistake",
    "links/base.py": "parts what a link says into what happened and what to do, both of them shown",
}
"""The only files that may look at how something is worded, and why."""
FILES_ALONE = ("files", "firmware", "vessel", "cli/params")
"""What speaks of files and parameters, never of a boat."""
PURE = ("pilot.py", "tick.py", "steering.py", "signals.py")
PURE_ROOMS = ("supervision", "guidance", "estimation", "control", "identification")


def name_of(node: ast.AST) -> str:
    """Return the last name of what is looked at: `sample.reason`, `self._reason`, `sentence_of(event)`, `alarms[0]`."""
    if isinstance(node, ast.Call):
        return name_of(node.func)
    if isinstance(node, ast.Subscript):
        return name_of(node.value)
    name = node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""
    return name.lstrip("_")


def is_sentence(node: ast.AST) -> bool:
    return name_of(node) in (*SENTENCES, *MAKERS)


def is_wording(node: ast.AST) -> bool:
    """Return whether this is a text of several words."""
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip()


def looks(tree: ast.AST) -> Iterator[int]:
    """Yield the lines that look at how a sentence is worded."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in LOOKS:
            is_tidied = node.func.attr == "split" and not node.args
            if (is_sentence(node.func.value) and not is_tidied) or any(
                is_wording(each) or is_sentence(each) for each in node.args[:1]
            ):
                yield node.lineno
        elif isinstance(node, ast.Compare):
            sides = (node.left, *node.comparators)
            member = isinstance(node.ops[0], (ast.In, ast.NotIn))
            if (
                (member and any(is_wording(side) for side in sides))
                or any(is_sentence(side) and any(is_wording(other) for other in sides) for side in sides)
                or any(name_of(side) in MAKERS for side in sides)
            ):
                yield node.lineno


def sources() -> list[Path]:
    package = ROOT / "autopilot"
    return [
        path for path in sorted(package.rglob("*.py")) if not str(path.relative_to(package)).startswith(FILES_ALONE)
    ]


def test_no_code_but_the_edges_looks_at_how_anything_is_worded() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in sources()
        if str(path.relative_to(ROOT / "autopilot")) not in EDGES
        for line in looks(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert found == []


def test_what_decides_does_not_even_know_the_sentences() -> None:
    package = ROOT / "autopilot"
    knows = [
        path.relative_to(package)
        for path in sources()
        if re.search(r"panel import [^\n]*\b(WORDS|sentences?_of)\b", path.read_text(encoding="utf-8"))
    ]
    assert Path("links/n2k/node.py") in knows, "who shows alarms knows their sentences"
    inner = [str(path) for path in knows if str(path) in PURE or path.parts[0] in PURE_ROOMS]
    assert [path for path in inner if path not in EDGES] == []


@pytest.mark.parametrize(
    "line",
    [
        "alarm.startswith(CANNOT_ENGAGE)",
        "any('heading lost' in text for text in tick.alarms)",
        "sample.reason.startswith('no heartbeat')",
        "said = self._reason == 'the radio is lost'",
        "text.removeprefix('NOT ACKNOWLEDGED: ')",
        "sentence_of(event) != before",
        "re.search('rudder does', words)",
        "str(error).partition(' of ')[0] and reason.split(';')",
    ],
)
def test_such_a_look_is_found(line: str) -> None:
    assert list(looks(ast.parse(line)))


@pytest.mark.parametrize(
    "line", ["alarm.name == 'roll'", "path.startswith('usb')", "kind_of(event).is_doubt", "if reason: pass"]
)
def test_what_looks_at_no_wording_is_left_alone(line: str) -> None:
    assert not list(looks(ast.parse(line)))
