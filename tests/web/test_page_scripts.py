"""Every script of the page is one that a JavaScript engine reads: one mistake leaves all displays blank."""

from __future__ import annotations

import json
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


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node.js")
def test_what_lies_across_the_date_line_is_near_on_the_chart() -> None:
    script = f"""
        import {{ seen }} from "{(PAGE / "chart.js").as_uri()}";
        console.log(JSON.stringify([seen([0, -179.999], [0, 179.999]), seen([0, 11.999], [0, 12])]));
        process.exit(0);
    """
    done = subprocess.run(
        ["node", "--input-type=module", "-e", script], capture_output=True, text=True, timeout=60, check=True
    )
    (across, north), (back, _) = json.loads(done.stdout)
    assert (across, north, back) == (pytest.approx(222.39), 0.0, pytest.approx(-111.195))
