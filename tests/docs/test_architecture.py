"""The page of the architecture names files and functions that exist, every page files that exist."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
STEPS = re.findall(r"^\| \d+ \| `([\w/.]+\.(?:py|yaml))`(?: `([\w.]+)`)? \|", PAGE, re.MULTILINE)
assert STEPS


def _defined(path: Path) -> set[str]:
    """Return the names of functions, classes and methods in a module, a method as `Class.method`."""
    names = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        if isinstance(node, ast.ClassDef):
            names |= {f"{node.name}.{each.name}" for each in node.body if isinstance(each, ast.FunctionDef)}
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {each.id for each in targets if isinstance(each, ast.Name)}
    return names


@pytest.mark.parametrize(("file", "function"), STEPS)
def test_a_step_names_a_file_and_a_function_that_exist(file: str, function: str) -> None:
    path = ROOT / file
    assert path.is_file()
    if function:
        assert function in _defined(path)


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.stem)
def test_a_file_that_a_page_names_exists(page: Path) -> None:
    named = set(re.findall(r"`((?:[\w]+/)+[\w]+\.(?:py|yaml|txt))`", page.read_text(encoding="utf-8")))
    roots = (ROOT, ROOT / "autopilot", ROOT / "sitl")
    assert [each for each in sorted(named) if not any((root / each).is_file() for root in roots)] == []
