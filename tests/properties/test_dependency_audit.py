"""The audit says what it found, and never passes silence off as a clean bill."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).parents[2] / ".ci" / "audit.py"
CLEAN = {"name": "numpy", "version": "2.4.6", "vulns": []}
WEAK = {"name": "pyyaml", "version": "5.3", "vulns": [{"id": "PYSEC-2021-142", "fix_versions": ["5.4"]}]}
UNKNOWN = {"name": "scipy", "skip_reason": "Dependency not found on PyPI and could not be audited: scipy (1.17.0)"}


def audit() -> Any:
    specification = importlib.util.spec_from_file_location("audit", SCRIPT)
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("packages", "code", "words"),
    [
        ([CLEAN, CLEAN], 0, "2 pinned packages audited, no weakness known"),
        ([CLEAN, UNKNOWN], 0, "1 pinned packages audited, no weakness known; 1 could not be looked up"),
        ([CLEAN, WEAK], 1, "pyyaml 5.3: PYSEC-2021-142, mended in 5.4"),
        ([UNKNOWN], 0, "NOT AUDITED"),
        ([], 0, "NOT AUDITED"),
    ],
)
def test_what_the_audit_says(packages: list[dict[str, Any]], code: int, words: str) -> None:
    found, said = audit().verdict({"dependencies": packages})
    assert found == code and words in said
