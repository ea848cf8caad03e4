"""Every script of the page is one that a JavaScript engine reads: one mistake leaves all displays blank."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

import autopilot.web

PAGE = Path(autopilot.web.__file__).parent / "page"


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node.js")
@pytest.mark.parametrize("script", sorted(PAGE.glob("*.js")), ids=lambda script: script.name)
def test_the_script_is_read_as_a_module(script: Path) -> None:
    done = subprocess.run(
        ["node", "--check", "--input-type=module"], input=script.read_bytes(), capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr.decode()
